"""docs/abstraction.md describes every parameter with a picture; all gallery clips have a suitable licence."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from docs.make_abstraction_figures import LOUDER, MOVES, STRIPS, captions, show_change, show_labels
from docs.make_gallery import GALLERY, PICTURES, SCENES, page
from docs.parameters import BEGIN, END, PAGE, section
from docs.pictures import CLIPS, DOCS, grid, save
from pipeline.methods.abstraction import Abstraction, AbstractionParams

PARAMETERS = [name for name in AbstractionParams.model_fields if name != "preroll"]  # it changes pieces only
PAGES = [PAGE, DOCS / "gallery.md", DOCS / "architecture.md", DOCS.parent / "README.md"]
COMMITTED_BYTES = 7 << 20


def test_the_parameters_section_matches_the_schema() -> None:
    """If this fails: `python -m docs.make_abstraction_figures --only table`."""
    text = PAGE.read_text().partition(BEGIN)[2].partition(END)[0]
    assert text.strip() == section(captions()).strip()


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_is_described_and_illustrated(name: str) -> None:
    field = AbstractionParams.model_fields[name]
    row = next(line for line in PAGE.read_text().splitlines() if line.startswith("| **") and f"`{name}`" in line)
    assert str(field.title) in row and str(field.description) in row
    assert (DOCS / "abstraction" / f"{name}.jpg").is_file()


def test_pictures_illustrate_existing_parameters_only() -> None:
    assert sorted(STRIPS) == sorted(PARAMETERS)


@pytest.mark.parametrize("name", PARAMETERS)
def test_shown_values_are_allowed(name: str) -> None:
    for value in STRIPS[name].values:
        AbstractionParams.model_validate({name: value})


def test_every_input_step_and_artefact_is_described() -> None:
    text = PAGE.read_text()
    names = [*(spec.name for spec in Abstraction.inputs), *(step.name for step in Abstraction.steps)]
    assert [name for name in (*names, *Abstraction.artefacts) if f"`{name}`" not in text] == []


def test_the_gallery_matches_its_script() -> None:
    """If this fails: `make gallery`."""
    assert (DOCS / "gallery.md").read_text() == page()


def test_the_gallery_has_every_listed_picture() -> None:
    promised = set(PICTURES) - {"hero", "methods"}
    assert [name for name in sorted(promised) if not (GALLERY / f"{name}.jpg").is_file()] == []


def test_committed_pictures_use_credited_clips() -> None:
    shown = {scene.clip for scene in SCENES.values()} | {strip.clip for strip in STRIPS.values()} - {"cut"}
    assert [name for name in sorted(shown) if not CLIPS[name].credit] == []


def test_committed_pictures_stay_small() -> None:
    sizes = {path.name: path.stat().st_size for path in DOCS.rglob("*") if path.suffix in (".jpg", ".svg", ".png")}
    assert sum(sizes.values()) < COMMITTED_BYTES
    assert [name for name, size in sizes.items() if size > 260_000] == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_resolve(path: Path) -> None:
    text = path.read_text()
    links = re.findall(r"\]\((?!http|#)([^)#]+)", text) + re.findall(r'<img src="([^"]+)"', text)
    assert links
    assert [link for link in links if not (path.parent / link).exists()] == []


def test_a_grid_has_the_requested_width_and_labels() -> None:
    tiles = [np.full((90, 160, 3), 40 * i, np.uint8) for i in range(4)]
    plain, named = grid(tiles, 3, width=308), grid(tiles, 3, ["a", "b", "c", "d"], width=308)
    assert plain.shape == (2 * 56 + 4, 308, 3)
    assert named.shape == (2 * 78 + 4, 308, 3)
    assert (plain[20, 120] == 40).all() and (plain[80, 20] == 120).all()


def test_a_saved_picture_stays_below_its_size_limit(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (200, 300, 3), np.uint8)
    roomy = save(noise, tmp_path / "a.jpg", 1 << 20).stat().st_size
    assert save(noise, tmp_path / "b.jpg", roomy - 10_000).stat().st_size <= roomy - 10_000


def test_the_change_map_is_dark_at_changes_and_blue_at_motion() -> None:
    still = np.zeros((40, 40, 3), np.uint8)
    blinks, moves = still.copy(), still.copy()
    blinks[0, 0] = 4
    moves[20:] = 90
    picture, mean = show_change([still, moves], [still, blinks])
    assert picture[0, 0].tolist() == [255 - 4 * LOUDER] * 3
    assert picture[5, 5].tolist() == [255] * 3
    assert picture[35, 35].tolist() == list(MOVES)
    assert mean == pytest.approx(4 / (picture[:, 0] != MOVES).any(axis=-1).sum() / 40)


def test_the_colour_of_a_region_depends_on_its_id() -> None:
    one = show_labels(np.array([[1, 2, 0]], np.int32), np.array([0, 7, 9]))
    two = show_labels(np.array([[2, 1, 0]], np.int32), np.array([0, 9, 7]))
    assert (one == two).all()
    assert one[0, 2].tolist() == [230, 20, 20]
