"""EXR: which picture is read, luminance, stereo, pixel aspect, facts that are stated, and files that are cut off."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import Imath
import numpy as np
import OpenEXR
import pytest

from pipeline.errors import BadParameter, UnreadableMedia
from pipeline.formats.base import Choice
from pipeline.formats.exr import EXR
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.media import Limits
from pipeline.video.probe import probe

H, W = 32, 48
R, G, B = (np.full((H, W), value, np.float32) for value in (0.5, 0.2, 0.05))
DARK = np.float32(0.1)
SHOWN = (188, 124, 63)
ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)


def rgb(prefix: str, letters: str = "RGB", scale: float = 1.0) -> dict[str, np.ndarray]:
    return {f"{prefix}{c}": (v * np.float32(scale)) for c, v in zip(letters, (R, G, B), strict=True)}


def made(path: Path, planes: dict[str, np.ndarray], **header: Any) -> bytes:
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    with OpenEXR.File(head, planes) as file:
        file.write(str(path))
    return path.read_bytes()


def parts(path: Path, *named: tuple[str, dict[str, Any], dict[str, np.ndarray]]) -> bytes:
    every = [OpenEXR.Part({"type": OpenEXR.scanlineimage} | head, planes, name) for name, head, planes in named]
    with OpenEXR.File(every) as file:
        file.write(str(path))
    return path.read_bytes()


def read(data: bytes, **choice: str) -> tuple[int, ...]:
    picture = EXR.read(data, Limits(), "a", Choice(**choice))
    return tuple(int(value) for value in picture[5, 5])


BEAUTIES = {
    "Blender": rgb("ViewLayer.Combined."), "Blender compositor": rgb("Composite.Combined."), "Karma": rgb("C.", "rgb"),
    "RenderMan": rgb("Ci.", "rgb"), "V-Ray": rgb("effectsResult."), "Unreal": rgb("FinalImage."),
    "Redshift": rgb("Main."), "Octane": rgb("Beauty main."), "Arnold": rgb("RGBA."), "lower case": rgb("", "rgb"),
    "words": {"red": R, "green": G, "blue": B}, "only layer": rgb("RenderLayer."), "Corona": rgb("Beauty."),
    "Houdini": rgb("beauty_master."),
}  # fmt: skip
OTHERS = rgb("diffuse.", scale=DARK) | rgb("N.") | {"depth.Z": R} | rgb("CryptoObject00.")


@pytest.mark.parametrize("renderer", BEAUTIES)
def test_the_usual_names_of_the_picture(renderer: str, tmp_path: Path) -> None:
    assert read(made(tmp_path / "a.exr", BEAUTIES[renderer])) == SHOWN


@pytest.mark.parametrize("renderer", [name for name in BEAUTIES if name != "only layer"])
def test_the_picture_is_found_among_other_passes(renderer: str, tmp_path: Path) -> None:
    assert read(made(tmp_path / "a.exr", BEAUTIES[renderer] | OTHERS)) == SHOWN


def test_unknown_layers_are_a_question(tmp_path: Path) -> None:
    data = made(tmp_path / "a.exr", rgb("key.") | rgb("fill.", scale=DARK))
    with pytest.raises(UnreadableMedia, match="fill, key"):
        read(data)
    assert read(data, layer="key") == SHOWN
    with pytest.raises(BadParameter, match="fill, key"):
        read(data, layer="rim")


def test_of_two_layers_one_is_read_and_named(tmp_path: Path) -> None:
    data = made(tmp_path / "a.exr", rgb("Char.Combined.", scale=0) | rgb("Set.Combined."))
    assert read(data, layer="Set") == SHOWN and read(data) == (0, 0, 0)
    assert EXR.notes(data) == (
        "The image has pictures in the layers Char.Combined, Set.Combined: Char.Combined is read.",
    )
    assert EXR.notes(data, Choice("Set")) == ()


@pytest.mark.parametrize(
    "planes",
    [
        rgb("") | rgb("right.", scale=DARK),
        rgb("ViewLayer.Combined.left.") | rgb("ViewLayer.Combined.right.", scale=DARK),
        rgb("left.") | rgb("right.", scale=DARK),
    ],
)
def test_stereo_in_one_part(planes: dict[str, np.ndarray], tmp_path: Path) -> None:
    data = made(tmp_path / "a.exr", planes, multiView=["left", "right"])
    assert read(data) == read(data, view="left") == SHOWN
    assert read(data, view="right") != SHOWN
    assert EXR.notes(data) == ("The image has the views left, right: left is read.",)
    with pytest.raises(BadParameter, match="left, right"):
        read(data, view="middle")


@pytest.mark.parametrize("names", [("rgba_left", "rgba_right"), ("left", "right"), ("rgba.left", "rgba.right")])
def test_stereo_in_parts(names: tuple[str, str], tmp_path: Path) -> None:
    data = parts(tmp_path / "a.exr", (names[0], {"view": "left"}, rgb("")),
                 (names[1], {"view": "right"}, rgb("", scale=DARK)))  # fmt: skip
    assert read(data) == SHOWN and read(data, view="right") != SHOWN


def test_luminance_alone_and_with_opacity(tmp_path: Path) -> None:
    assert read(made(tmp_path / "a.exr", {"Y": G})) == (124, 124, 124)
    assert read(made(tmp_path / "b.exr", {"Y": G, "A": np.ones_like(G)})) == (124, 124, 124, 255)


def test_luminance_and_chroma_of_half_resolution(tmp_path: Path) -> None:
    luminance = 0.2126 * R + 0.7152 * G + 0.0722 * B
    chroma = {"RY": (R / luminance - 1)[::2, ::2], "BY": (B / luminance - 1)[::2, ::2]}
    kind, header = Imath.PixelType(Imath.PixelType.FLOAT), OpenEXR.Header(W, H)
    header["channels"] = {"Y": Imath.Channel(kind), "RY": Imath.Channel(kind, 2, 2), "BY": Imath.Channel(kind, 2, 2)}
    out = OpenEXR.OutputFile(str(tmp_path / "a.exr"), header)
    planes = {"Y": luminance} | chroma
    out.writePixels({name: np.ascontiguousarray(plane).tobytes() for name, plane in planes.items()})
    out.close()
    assert np.abs(np.subtract(read((tmp_path / "a.exr").read_bytes()), SHOWN)).max() <= 1


@pytest.mark.parametrize(("aspect", "size"), [(2.0, (96, 32)), (0.5, (48, 64)), (1.0, (48, 32))])
def test_pixels_become_square(aspect: float, size: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    made(path, rgb(""), pixelAspectRatio=aspect)
    info = probe(path)
    assert (info.width, info.height) == size
    assert any("aspect" in note for note in info.notes) == (aspect != 1)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ({"chromaticities": ACES}, "lin_ap0_scene"),
        ({"colorInteropID": "lin_ap1_scene"}, "lin_ap1_scene"),
        ({"colorInteropID": "lin_rec709_scene"}, ""),
        ({"dataWindow": ((-4, -4), (43, 27)), "displayWindow": ((0, 0), (39, 23))}, "overscan"),
    ],
)
def test_what_is_not_done_is_said(header: dict[str, Any], said: str, tmp_path: Path) -> None:
    windows = {n: tuple(np.array(c, np.int32) for c in v) if n.endswith("Window") else v for n, v in header.items()}
    notes = " ".join(EXR.notes(made(tmp_path / "a.exr", rgb(""), **windows)))
    assert said in notes and bool(notes) == bool(said)


@pytest.mark.parametrize("compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIP_COMPRESSION, OpenEXR.PIZ_COMPRESSION])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.95])
def test_a_cut_file_never_shows_the_frame_before(compression: Any, share: float, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).random((64, 64)).astype(np.float32)
    one = made(tmp_path / "a.exr", dict.fromkeys("RGB", noise), compression=compression)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("f.1001.exr", one)
        archive.writestr("f.1002.exr", one[: int(share * len(one))])
    with GuardedReader(tmp_path / "a.zip") as reader, pytest.raises(UnreadableMedia) as caught:
        list(reader.read())
    assert "f.1002.exr" in str(caught.value)
