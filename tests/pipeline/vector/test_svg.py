"""SVG output: exact label maps, shared boundaries, ids, invalid input."""

import re
from collections import Counter
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadFrame
from pipeline.frames import Labels
from pipeline.vector.borders import find_borders
from pipeline.vector.outlines import rings, simplify, smooth, trace
from pipeline.vector.smoothing import smooth_borders
from pipeline.vector.stroke_outlines import stroke_outlines
from pipeline.vector.svg import Lines, to_svg

SVG = "{http://www.w3.org/2000/svg}"
Polygon = NDArray[np.float64]


def colours_for(labels: Labels) -> NDArray[np.uint8]:
    return np.random.default_rng(9).integers(0, 256, (int(labels.max()) + 1, 3), np.uint8)


def blobs(size: tuple[int, int] = (64, 48), count: int = 9, seed: int = 0, sigma: float = 4) -> Labels:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).random((size[1], size[0])), (0, 0), sigma)
    ranks = noise.ravel().argsort().argsort().reshape(noise.shape)
    return (1 + ranks * count // ranks.size).astype(np.int32)


def confetti(size: tuple[int, int] = (17, 13), seed: int = 0) -> Labels:
    """All kinds of corners: touching diagonals, single pixels, holes, unlabelled pixels."""
    return np.random.default_rng(seed).integers(0, 4, (size[1], size[0])).astype(np.int32)


def elements(document: bytes) -> dict[str, ElementTree.Element]:
    return {e.attrib["id"]: e for e in ElementTree.fromstring(document).iter(f"{SVG}path") if "id" in e.attrib}


def polygons(path: str, steps: int = 1) -> list[Polygon]:
    """The closed polygons of path data made of M, l, c and z, in tenths of a px.

    Args:
        steps: pieces into which each curve is divided; 1 = its control points.
    """
    found = []
    for ring in path.split("z")[:-1]:
        points: list[NDArray[np.float64]] = []
        for command, text in re.findall(r"([Mlc])([^Mlc]*)", ring):
            numbers = np.array(text.split(), float).reshape(-1, 2) * 10
            for piece in numbers.reshape(-1, 3 if command == "c" else 1, 2):
                start = points[-1] if points else np.zeros(2)
                points += list(start + (curve(piece, steps) if command == "c" and steps > 1 else piece))
        np.testing.assert_allclose(points[0], points[-1], atol=1e-6)
        found.append(np.array(points[:-1]))
    return [np.rint(polygon) if steps == 1 else polygon for polygon in found]


def curve(inner: Polygon, steps: int) -> Polygon:
    """Points on a cubic Bezier curve that starts at (0, 0)."""
    u = np.linspace(0, 1, steps + 1)[1:, None]
    return 3 * u * (1 - u) ** 2 * inner[0] + 3 * u**2 * (1 - u) * inner[1] + u**3 * inner[2]


def filled(shapes: list[Polygon], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Even-odd fill at pixel centres: every edge that crosses a row's middle flips all pixels to its right."""
    inside = np.zeros((size[1], size[0]), bool)
    for polygon in shapes:
        for (x0, y0), (x1, y1) in zip(polygon / 10, np.roll(polygon, -1, axis=0) / 10, strict=True):
            for row in range(size[1]):
                middle = row + 0.5
                if min(y0, y1) <= middle < max(y0, y1):
                    crossing = x0 + (middle - y0) / (y1 - y0) * (x1 - x0)
                    inside[row, max(0, int(np.ceil(crossing - 0.5))) :] ^= True
    return inside


def area(shapes: list[Polygon]) -> float:
    return sum(float(np.dot(p[:, 0], np.roll(p[:, 1], -1)) - np.dot(p[:, 1], np.roll(p[:, 0], -1))) / 2 for p in shapes)


@pytest.mark.parametrize(
    "labels",
    [
        blobs(),
        confetti(),
        confetti((40, 31), seed=1),
        np.ones((16, 20), np.int32),
        np.eye(16, dtype=np.int32) + 1,
        (np.indices((16, 16)).sum(axis=0) % 2 + 1).astype(np.int32),
        np.pad(np.pad(np.full((4, 4), 3, np.int32), 3, constant_values=2), 3, constant_values=1),
    ],
    ids=["blobs", "confetti", "more confetti", "one region", "diagonal", "chessboard", "nested"],
)
def test_without_simplification_the_label_map_comes_back_exactly(labels: Labels) -> None:
    paths = elements(to_svg(labels, colours_for(labels), tolerance_px=0, smoothing=0))
    size = (labels.shape[1], labels.shape[0])
    assert set(paths) == {f"r{label}" for label in np.unique(labels) if label > 0}
    for label in np.unique(labels[labels > 0]):
        found = filled(polygons(paths[f"r{label}"].attrib["d"]), size)
        np.testing.assert_array_equal(found, labels == label, err_msg=f"label {label}")


@pytest.mark.parametrize(("tolerance", "passes"), [(0.0, 0), (0.5, 0), (0.0, 4), (0.5, 4), (3.0, 2)])
@pytest.mark.parametrize("labels", [blobs(), confetti((40, 31), seed=2) + 1], ids=["blobs", "confetti"])
def test_neighbours_share_every_edge_after_simplification(labels: Labels, tolerance: float, passes: int) -> None:
    """Each edge is walked once either way, except on the frame; so no gap, no overlap, and areas add up."""
    paths = elements(to_svg(labels, colours_for(labels), tolerance_px=tolerance, smoothing=passes))
    shapes = [polygon for path in paths.values() for polygon in polygons(path.attrib["d"])]
    edges: Counter[tuple[float, ...]] = Counter()
    for polygon in shapes:
        edges.update((*a, *b) for a, b in zip(polygon.tolist(), np.roll(polygon, -1, axis=0).tolist(), strict=True))
    height, width = (10 * side for side in labels.shape)
    for (x0, y0, x1, y1), count in edges.items():
        on_frame = (x0 == x1 and x0 in (0, width)) or (y0 == y1 and y0 in (0, height))
        assert count == edges[(x1, y1, x0, y0)] or on_frame
    assert abs(area(shapes)) == pytest.approx(height * width)


def test_smoothing_and_simplifying_stay_near_the_boundary_and_save_space() -> None:
    labels = blobs((160, 120), 7, sigma=12)
    exact = to_svg(labels, colours_for(labels), tolerance_px=0, smoothing=0)
    nice = to_svg(labels, colours_for(labels))
    assert len(nice) < len(exact) / 2
    paths = elements(nice)
    wrong = sum(
        int((filled(polygons(paths[f"r{label}"].attrib["d"], 16), (160, 120)) & (labels != label)).sum())
        for label in np.unique(labels)
    )
    assert wrong < 0.03 * labels.size


def test_tolerance_bounds_how_far_a_boundary_moves() -> None:
    outlines = smooth(trace(blobs().astype(np.int32)), 4)
    for tolerance in (0.3, 1.0):
        simple = simplify(outlines, tolerance)
        for arc in range(len(outlines.left)):
            before = outlines.points[outlines.starts[arc] : outlines.starts[arc + 1]]
            after = simple.points[simple.starts[arc] : simple.starts[arc + 1]]
            assert max(distance(point, after) for point in before) <= tolerance + 1e-9


def test_curves_stay_near_the_smoothed_border_and_have_fewer_corners() -> None:
    """Fitted curves stay within the tolerance, have no corners, and need less text than a polyline."""
    y, x = np.mgrid[:96, :128]
    labels = (1 + (np.hypot(x - 60.3, y - 47.8) < 31.4)).astype(np.int32)
    borders = smooth_borders(find_borders(labels), 2.0, 1.5)
    path = elements(to_svg(labels, colours_for(labels), smoothing=borders, tolerance_px=0.3))["r2"].attrib["d"]
    (circle,) = polygons(path, steps=24)
    assert np.abs(np.hypot(*(circle / 10 - (60.8, 48.3)).T) - 31.4).max() < 0.8
    sides = np.diff(circle, axis=0, append=circle[:1])
    turns = np.abs((np.diff(np.arctan2(*sides.T), prepend=np.nan) + np.pi) % (2 * np.pi) - np.pi)[1:]
    assert np.nanmax(turns) < np.radians(12)
    assert len(polygons(path)[0]) <= 3 * 24, "at most 24 curves"


def distance(point: NDArray[np.float64], line: Polygon) -> float:
    ends = np.diff(line, axis=0)
    along = ((point - line[:-1]) * ends).sum(axis=1) / np.maximum((ends * ends).sum(axis=1), 1e-12)
    nearest = line[:-1] + np.clip(along, 0, 1)[:, None] * ends
    return float(np.linalg.norm(nearest - point, axis=1).min())


@pytest.mark.parametrize("labels", [blobs(), confetti() + 1], ids=["blobs", "confetti"])
def test_smoothed_borders_are_drawn_as_they_are(labels: Labels) -> None:
    """Every corner of a path is a node of a border, and the regions tile the frame."""
    borders = smooth_borders(find_borders(labels), 1.5, 1.0)
    made = elements(to_svg(labels, colours_for(labels), smoothing=borders, tolerance_px=0))
    shapes = {name: polygons(element.attrib["d"]) for name, element in made.items()}
    frame = [(0, 0), (10 * labels.shape[1], 10 * labels.shape[0])]
    nodes = {(x, y) for x, y in np.rint(10 * borders.positions.astype(float)).tolist()}
    for polygon in (polygon for found in shapes.values() for polygon in found):
        for x, y in polygon.tolist():
            assert (x, y) in nodes or x in (frame[0][0], frame[1][0]) or y in (frame[0][1], frame[1][1])
    assert sum(abs(area(found)) for found in shapes.values()) == pytest.approx(100 * labels.size)


def test_four_regions_around_a_junction() -> None:
    labels = np.array([[1, 2], [3, 4]], np.int32).repeat(8, axis=0).repeat(8, axis=1)
    outlines = simplify(trace(labels), 0)
    assert len(outlines.left) == 4 + 8, "four arms, and each border in two"
    assert not outlines.loops.any()
    assert all(len(chains) == 1 and len(chains[0]) == 4 for chains in rings(outlines).values())


def test_an_enclosed_region_is_a_hole_of_its_surroundings() -> None:
    labels = np.ones((16, 16), np.int32)
    labels[5:9, 6:12] = 2
    outlines = simplify(trace(labels), 0)
    assert outlines.loops.sum() == 1
    chains = rings(outlines)
    assert [len(chains[label]) for label in (1, 2)] == [2, 1]


def test_paths_have_the_ids_and_colours_of_their_regions() -> None:
    labels = np.repeat(np.array([[1, 2]], np.int32), 16, axis=0).repeat(8, axis=1)
    colours = np.array([[0, 0, 0], [255, 128, 1], [2, 3, 4]], np.uint8)
    paths = elements(to_svg(labels, colours, np.array([0, 17, 123456789012])))
    assert {name: path.attrib["fill"] for name, path in paths.items()} == {"r17": "#ff8001", "r123456789012": "#020304"}
    assert all(path.attrib["stroke"] == path.attrib["fill"] for path in paths.values())


def test_a_region_keeps_its_path_when_only_others_change() -> None:
    labels = np.ones((24, 24), np.int32)
    labels[4:10, 4:10] = 2
    labels[15:20, 12:18] = 3
    changed = np.where(labels == 3, 1, labels).astype(np.int32)
    before, after = (elements(to_svg(m, colours_for(labels))) for m in (labels, changed))
    assert before["r2"].attrib == after["r2"].attrib
    assert "r3" not in after


def test_lines_lie_on_top_as_outlines_of_strokes() -> None:
    labels = blobs()
    places = np.array([[5, 11], [40, 11], [10, 20], [10, 40], [30, 20], [30, 40]], np.float32)
    opacities = np.array([1, 1, 0.5, 0.5, 0, 0], np.float32)
    strokes = stroke_outlines(places, np.full(6, 1.5, np.float32), opacities, np.array([0, 2, 4, 6], np.int32))
    document = to_svg(labels, colours_for(labels), lines=Lines(strokes, (10, 20, 30), 0.8))
    lines = next(group for group in ElementTree.fromstring(document) if group.attrib["id"] == "lines")
    assert lines.attrib["fill"] == "#0a141e"
    assert [path.attrib["fill-opacity"] for path in lines] == ["0.80", "0.40"], "invisible strokes have no path"
    drawn = polygons(lines[0].attrib["d"], steps=8)
    assert abs(area(drawn)) / 100 == pytest.approx(35 * 3 + 1.5 * 3, rel=0.05), "35 px long, 3 px wide, pointed ends"


def test_no_lines_and_no_regions_give_an_empty_document() -> None:
    nothing = np.zeros((16, 16), np.int32)
    assert elements(to_svg(nothing, np.zeros((1, 3), np.uint8))) == {}


def test_the_same_map_gives_the_same_bytes() -> None:
    labels = confetti((40, 31))
    assert to_svg(labels, colours_for(labels)) == to_svg(labels.copy(), colours_for(labels))


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"labels": np.full((16, 16), -1, np.int32)}, "labels"),
        ({"labels": np.zeros((16, 16, 1), np.int32)}, "labels"),
        ({"labels": np.zeros((16, 16), np.float32)}, "labels"),
        ({"labels": np.full((16, 16), 2, np.int32)}, "colours"),
        ({"colours": np.zeros((2, 3), np.float32)}, "colours"),
        ({"colours": np.zeros((2, 4), np.uint8)}, "colours"),
        ({"ids": np.arange(3)}, "ids"),
    ],
)
def test_inconsistent_arguments_are_rejected(change: dict[str, Any], field: str) -> None:
    given: dict[str, Any] = {"labels": np.ones((16, 16), np.int32), "colours": np.zeros((2, 3), np.uint8)}
    with pytest.raises(BadFrame) as refusal:
        to_svg(**(given | change))
    assert refusal.value.field == field
