"""Small well-formed files of every kind that is decoded, from which mutations start."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Mapping
from fractions import Fraction
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np
from PIL import Image

from pipeline.formats.exr import write_exr
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files
from tests.pipeline.video.making import make_video, make_zip, picture, png_frames

SIZE = (48, 32)
_VIDEOS = {"mp4": "libx264", "mkv": "mpeg4", "webm": "libvpx-vp9", "avi": "mjpeg"}


@cache
def samples() -> Mapping[str, tuple[bytes, ...]]:
    """Kind -> files."""
    frames = [picture(index, *SIZE) for index in range(6)]
    with TemporaryDirectory() as name:
        folder = Path(name)
        made: dict[str, tuple[Path, ...]] = {
            kind: (make_video(folder / f"v.{kind}", frames, codec, "yuvj420p" if kind == "avi" else "yuv420p"),)
            for kind, codec in _VIDEOS.items()
        }
        made["mp4"] += (make_video(folder / "sound.mp4", frames, click_s=[0.1], rotation_ccw=90),)
        made["avi"] += (make_video(folder / "b.avi", frames, "mpeg4", options={"bf": "2"}),)
        made["ts"] = tuple(_broadcasts(folder))
        made["flv"] = (make_video(folder / "v.flv", frames, "flv"),)
        made["mov"] = (make_video(folder / "deep.mov", frames, "prores_ks", "yuv422p10le", click_s=[0.1]),)
        made["gif"] = (make_video(folder / "v.gif", frames, "gif", "rgb8"),)
        made["zip"] = (make_zip(folder / "v.zip", png_frames(3, *SIZE)),)
        made["shot"] = (make_zip(folder / "shot.zip", dict(shot_files(scene("shapes", SIZE, frames=2)))),)
        made["zip"] += (_odd_zip(folder / "odd.zip"),)
        made["exr"] = tuple(_exr(folder / f"{half}.exr", half) for half in (False, True))
        found = {kind: tuple(path.read_bytes() for path in paths) for kind, paths in made.items()}
    found |= {kind: (_still(f".{kind}"), _still(f".{kind}", gray=True)) for kind in ("png", "jpg", "webp")}
    import pipeline.formats.iso_images  # noqa: F401 - registers the writer of HEIF with Pillow

    forms = ("AVIF", "HEIF", "TIFF", "BMP", "TGA", "JPEG2000", "PSD", "PPM", "ICO", "PCX", "SGI")
    animated = {f"animated-{form.lower()}": _by_pillow(form)[2:] for form in ("PNG", "WEBP", "GIF")}
    return found | {form.lower(): _by_pillow(form) for form in forms} | animated | {"dpx": _dpx()}


def _dpx() -> tuple[bytes, ...]:
    made = []
    for pixel_format in ("rgb24", "gbrp10be", "rgba"):
        codec = av.CodecContext.create("dpx", "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt, codec.time_base = *SIZE, pixel_format, Fraction(1, 24)
        shown = av.VideoFrame.from_ndarray(picture(1, *SIZE), format="rgb24").reformat(format=pixel_format)
        made.append(b"".join(bytes(packet) for packet in [*codec.encode(shown), *codec.encode(None)]))
    return tuple(made)


def _by_pillow(form: str) -> tuple[bytes, ...]:
    """Stills with and without alpha, and an animation where the format has it."""
    pictures = [Image.fromarray(picture(index, *SIZE)) for index in range(3)]
    clear = pictures[0].copy()
    clear.putalpha(128)
    made = []
    for image, more in ((pictures[0], {}), (clear, {}), (pictures[0], {"save_all": True, "append_images": pictures})):
        if form == "PSD":
            return (_PSD,)
        out = io.BytesIO()
        with contextlib.suppress(OSError, ValueError, KeyError):
            image.save(out, form, **more)
            made.append(out.getvalue())
    return tuple(made)


_PSD = (
    b"8BPS\0\1" + bytes(6) + struct.pack(">HIIHH", 3, SIZE[1], SIZE[0], 8, 3) + bytes(12) + b"\0\0"
    + bytes(range(256)) * (3 * SIZE[0] * SIZE[1] // 256)
)  # fmt: skip


def _odd_zip(path: Path) -> Path:
    """A sequence with a gap, options, backslashes and names as image programs write them."""
    options = b'{"missing": "hold", "fps": "24000/1001", "pattern": "a_####.png"}'
    frames = {
        f"shot\\a_{number:04d}.png": data
        for number, data in zip((-1, 1, 4), png_frames(3, *SIZE).values(), strict=True)
    }
    return make_zip(path, frames | {"shot\\sequence.json": options})


def _broadcasts(folder: Path) -> list[Path]:
    """Interlaced pictures with sound, and two transport streams joined."""
    frames = [picture(index, *SIZE) for index in range(6)]
    fields = {"x264-params": "interlaced=1:tff=1"}
    one = make_video(folder / "i.ts", frames, options=fields, click_s=[0.1], audio_codec="mp2")
    two = folder / "joined.ts"
    two.write_bytes(2 * make_video(folder / "p.ts", frames, "mpeg2video", click_s=[0.1]).read_bytes())
    return [one, two]


def _exr(path: Path, half: bool) -> Path:
    plane = np.linspace(0, 1, SIZE[0] * SIZE[1], dtype=np.float32).reshape(SIZE[1], SIZE[0])
    write_exr(path, {"R": plane, "G": plane, "B": plane, "Vector.X": plane}, half)
    return path


def _still(extension: str, gray: bool = False) -> bytes:
    image = picture(3, *SIZE)
    done, data = cv2.imencode(extension, image[..., 0] if gray else image)
    assert done
    return io.BytesIO(data.tobytes()).getvalue()
