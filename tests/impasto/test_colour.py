"""Depth, colour spaces and painted opacity of films of a real farm: what is read deep is delivered deep."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import OpenEXR
import pytest

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.video.media import SourceOptions
from pipeline.video.stills import encode_png
from pipeline.video.wide_colour import PQ
from tests.pipeline.video.test_wide_colour import clip, pq
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

WIDTH, HEIGHT = 1024, 64
RAMP = np.ascontiguousarray(
    np.broadcast_to(
        (np.arange(WIDTH) * 60000 // (WIDTH - 1) + 2000).astype(np.uint16)[None, :, None], (HEIGHT, WIDTH, 3)
    )
)
"""1,024 steps of gray."""
AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
"""Chromaticities of ACEScg."""


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("farm"), pool="local", workers=1))
    opened.start()
    yield opened
    opened.stop()


def zipped(path: Path, images: list[bytes], suffix: str) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for index, image in enumerate(images):
            archive.writestr(f"plate.{1001 + index}.{suffix}", image)
    return path


def film(farm: Farm, plate: Path, method: str, output: OutputSpec, **more: Any) -> tuple[zipfile.ZipFile, str]:
    """The film's zip, and the job's warnings."""
    data, warnings = job(farm, plate, method, output, **more)
    return zipfile.ZipFile(io.BytesIO(data)), warnings


def job(farm: Farm, plate: Path, method: str, output: OutputSpec, **more: Any) -> tuple[bytes, str]:
    """The film, and the job's warnings."""
    asset = farm.assets.add(plate, plate.name).id
    extra = {"convert": ("film",), "steady": ("styled",)}.get(method, ())
    inputs = dict.fromkeys(("video", *extra), asset)
    work, last_seq = farm.jobs.submit(JobRequest(method, inputs, output=output, **more)).id, 0
    while not farm.jobs.get(work).state.final:
        farm.jobs.wait_for_event(work, last_seq, 5.0)
        last_seq = max((event.seq for event in farm.jobs.events(work, last_seq)[0]), default=last_seq)
    done = farm.jobs.get(work)
    assert done.state == "succeeded", done.error
    data = b"".join(farm.files.read(farm.files.get(work, "result")))
    return data, " ".join(warning.message for warning in done.warnings)


def png(archive: zipfile.ZipFile, at: int = 0) -> AnyArray:
    stored = cv2.imdecode(np.frombuffer(archive.read(archive.namelist()[at]), np.uint8), cv2.IMREAD_UNCHANGED)
    return stored[..., [2, 1, 0, 3][: stored.shape[2]]]


def exr(data: bytes) -> tuple[AnyArray, dict[str, Any]]:
    with OpenEXR.File(io.BytesIO(data)) as file:
        name = next(iter(file.channels()))
        return file.channels()[name].pixels.copy(), dict(file.header())


@pytest.mark.parametrize(("method", "least", "most"), [
    ("convert", 1024, 1024), ("steady", 1000, 1100), ("multistyle", 400, 1 << 16), ("patches", 400, 1 << 16),
    ("abstraction", 1, 256),
])  # fmt: skip
def test_a_ramp_keeps_the_steps_that_the_method_computes(
    method: str, least: int, most: int, farm: Farm, tmp_path: Path
) -> None:
    source = zipped(tmp_path / "ramp.zip", [encode_png(RAMP)] * 3, "png")
    archive, notes = film(farm, source, method, OutputSpec("png", profile="16"))
    shown = png(archive, 2)
    assert shown.dtype == np.uint16 and least <= len(np.unique(shown[..., 1])) <= most
    assert ("8 bit a channel" in notes) == (method == "abstraction")
    if method in ("convert", "steady"):
        assert np.abs(shown.astype(int) - RAMP).max() <= (0 if method == "convert" else 130)


def test_layers_are_composited_in_floating_point(farm: Farm, tmp_path: Path) -> None:
    source = zipped(tmp_path / "ramp.zip", [encode_png(RAMP)] * 2, "png")
    rows = [{"method": "abstraction", "opacity": 0.3}]
    archive, _ = film(farm, source, "layers", OutputSpec("png", profile="16"), params={"layers": rows})
    assert len(np.unique(png(archive)[..., 1])) > 600


CONVERTED: dict[str, Any] = {"method": "convert"}
UNPAINTED: dict[str, Any] = {
    "method": "layers", "params": {"layers": [{"method": "abstraction", "opacity": 0}]}
}  # fmt: skip
"""The video under a layer that is not seen."""


def acescg(tmp_path: Path, alpha: bool) -> list[bytes]:
    """Frames in ACEScg: colours outside Rec. 709, light of 6, darkness; premultiplied."""
    rng, images = np.random.default_rng(3), []
    for _ in range(2):
        light = (rng.random((48, 64, 3)) ** 3 * 6).astype(np.float32)
        clear = rng.choice([1.0, 0.5, 0.25], (48, 64, 1)).astype(np.float32)
        stored = np.dstack([light * clear, clear]) if alpha else light
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "chromaticities": AP1}
        out = io.BytesIO()
        with OpenEXR.File(header, {"RGBA"[: stored.shape[2]]: stored.astype(np.float16)}) as file:
            file.write(out)
        images.append(out.getvalue())
    return images


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("given", ["", "ACEScg"])
@pytest.mark.parametrize("work", [CONVERTED, UNPAINTED])
def test_acescg_is_written_back_as_it_was_read(
    work: dict[str, Any], given: str, alpha: bool, farm: Farm, tmp_path: Path
) -> None:
    images = acescg(tmp_path, alpha)
    source = zipped(tmp_path / "aces.zip", images, "exr")
    output = OutputSpec("exr", colour="ACEScg")
    archive, notes = film(farm, source, output=output, source=SourceOptions(colour=given), **work)
    assert "ACEScg, as given" in notes if given else "lin_ap1_scene" in notes
    for number, stored in enumerate(images):
        wanted, _ = exr(stored)
        found, header = exr(archive.read(f"{1001 + number}.exr"))
        assert found.shape == wanted.shape and header["colorInteropID"] == "lin_ap1_scene"
        np.testing.assert_allclose(header["chromaticities"], AP1, atol=1e-3)
        steps = np.spacing(np.maximum(np.abs(wanted), np.float16(0.01)))  # half-float precision
        assert (np.abs(found.astype(np.float64) - wanted) <= steps.astype(np.float64)).all()


def test_a_view_is_inverted_on_the_way_out(farm: Farm, tmp_path: Path) -> None:
    """Colours that the view shows come back; a scene-linear 0.18 is 89 in the view."""
    view = "ACES 2.0 - SDR 100 nits (Rec.709)"
    light = np.full((48, 64, 3), 0.18, np.float16)
    out = io.BytesIO()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "chromaticities": AP1}
    with OpenEXR.File(header, {"RGB": light}) as file:
        file.write(out)
    source, options = (
        zipped(tmp_path / "a.zip", [out.getvalue()], "exr"),
        SourceOptions(colour="ACEScg", colour_view=view),
    )
    archive, _ = film(farm, source, output=OutputSpec("png"), source=options, **UNPAINTED)
    assert np.abs(png(archive).astype(int) - 89).max() <= 1
    archive, _ = film(farm, source, output=OutputSpec("exr", colour="ACEScg"), source=options, **UNPAINTED)
    np.testing.assert_allclose(exr(archive.read("1001.exr"))[0].astype(float), 0.18, rtol=0.01)


@pytest.mark.parametrize("view", ["", "ACES 2.0 - SDR 100 nits (Rec.709)"])
def test_an_hdr_film_has_the_light_of_its_hdr_source(view: str, farm: Farm, tmp_path: Path) -> None:
    """Grays of 20 to 600 cd/m2 in PQ: those above diffuse white are kept by the view, and cut off without one. The
    usual film of the same source is BT.709."""
    nits = np.repeat(np.geomspace(20, 600, 16), 16)
    rgb = np.ascontiguousarray(np.broadcast_to(pq(nits)[None, :, None] * 65535, (64, 256, 3)).astype(np.uint16))
    source = clip(tmp_path / "hdr.mkv", rgb, 9, PQ)
    options = SourceOptions(colour_view=view)
    for output, transfer in ((OutputSpec("mov", profile="422hq", colour="PQ"), PQ), (OutputSpec("mov"), 6)):
        data, notes = job(farm, source, output=output, source=options, **UNPAINTED)
        assert "BT.2020 PQ" in notes
        with av.open(io.BytesIO(data)) as container:
            picture = next(container.decode(video=0))
            assert (int(picture.color_trc), picture.format.name) == (transfer, "yuv422p10le")
            luma = np.frombuffer(memoryview(picture.planes[0]), "<u2").reshape(64, -1)[32, 8:256:16]
        if transfer == PQ:
            wanted = pq(nits[8::16] if view else np.minimum(nits[8::16], 203))
            assert np.abs((luma - 64.0) / 876 - wanted).max() < 0.012


def test_names_are_checked_when_the_job_is_submitted(farm: Farm, tmp_path: Path) -> None:
    source = zipped(tmp_path / "ramp.zip", [encode_png(RAMP)], "png")
    for field, output, options in (
        ("source.colour", OutputSpec("png"), SourceOptions(colour="ACESgg")),
        ("source.colour_view", OutputSpec("png"), SourceOptions(colour_view="Filmic")),
        ("output.colour", OutputSpec("exr", colour="ACESgg"), SourceOptions()),
        ("output.colour", OutputSpec("mp4", colour="ACEScg"), SourceOptions()),
    ):
        with pytest.raises(BadParameter) as caught:
            film(farm, source, "convert", output, source=options)
        assert caught.value.field == field and caught.value.remedy


# -- painted opacity

Y, X = np.mgrid[:180, :240]
DISC = np.rint(np.clip((60 - np.hypot(X - 120, Y - 90)) / 2 + 0.5, 0, 1) * 255).astype(np.uint8)
PLATES = ((200, 30, 30), (30, 180, 40), (0, 0, 0))


def cut_out(index: int) -> AnyArray:
    """An orange disc with a soft pattern, whose transparent surroundings are black: the worst for fringes."""
    shade = (np.sin((X + 2 * index) / 9) * 30).astype(int)
    colours = np.dstack([220 + shade // 2, 140 + shade, 40 + shade // 2]).clip(0, 255)
    return np.dstack([np.where(DISC[..., None] > 0, colours, 0), DISC]).astype(np.uint8)


def linear(colour: object) -> AnyArray:
    encoded = np.asarray(colour) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("plate", PLATES)
def test_a_layer_of_strokes_has_no_fringe_over_another_plate(plate: object, farm: Farm, tmp_path: Path) -> None:
    """The strokes' coverage, in OpenEXR's arithmetic: over = layer + (1 - alpha) plate, in linear light."""
    source = zipped(tmp_path / "disc.zip", [encode_png(cut_out(index)) for index in range(3)], "png")
    archive, _ = film(farm, source, "multistyle", OutputSpec("exr", alpha="painted"))
    layer = exr(archive.read("1002.exr"))[0].astype(np.float64)
    alpha = layer[..., 3:]
    over = layer[..., :3] + (1 - alpha) * linear(plate)
    assert alpha[90, 120] > 0.9 and alpha[5, 5] == 0 and np.abs(over[5, 5] - linear(plate)).max() < 1e-3
    partly = (alpha[..., 0] > 0.2) & (alpha[..., 0] < 0.8)
    assert partly.sum() > 60, "strokes have soft ends"
    straight = layer[partly][:, :3] / alpha[partly]
    assert np.percentile(straight[:, 0], 2) > 0.35 and np.percentile(straight[:, 2], 98) < 0.35, "orange, unmixed"
    low, high = np.minimum(linear(plate), straight.min(0)), np.maximum(linear(plate), straight.max(0))
    assert (over[partly] >= low - 1e-3).all() and (over[partly] <= high + 1e-3).all()


def test_a_layer_alone_has_its_matte_and_its_opacity(farm: Farm, tmp_path: Path) -> None:
    source = zipped(tmp_path / "ramp.zip", [encode_png(RAMP)], "png")
    rows = [{"method": "abstraction", "opacity": 0.5}]
    wanted = {"params": {"layers": rows, "alone": True}}
    archive, _ = film(farm, source, "layers", OutputSpec("png", profile="16", alpha="painted"), **wanted)
    alone = png(archive)
    assert alone.shape[2] == 4 and np.abs(alone[..., 3].astype(int) - 32768).max() <= 1
    full, _ = film(farm, source, "abstraction", OutputSpec("png"))
    np.testing.assert_array_equal(alone[..., :3] // 257, png(full))
    with pytest.raises(BadParameter) as caught:
        film(farm, source, "layers", OutputSpec("png"), **wanted)
    assert caught.value.field == "output.alpha" and "painted" in caught.value.remedy


def test_the_library_gives_the_same_frames_as_the_farm(farm: Farm, tmp_path: Path) -> None:
    import impasto

    source = zipped(tmp_path / "disc.zip", [encode_png(cut_out(index)) for index in range(3)], "png")
    archive, _ = film(farm, source, "multistyle", OutputSpec("exr", alpha="painted", colour="ACEScg"))
    wanted = impasto.OutputFile(tmp_path / "comp" / "c.####.exr", alpha="painted", colour="ACEScg")
    impasto.render("multistyle", source, wanted)
    for number in (1001, 1003):
        assert archive.read(f"{number}.exr") == (tmp_path / "comp" / f"c.{number}.exr").read_bytes()
