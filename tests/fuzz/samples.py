"""Small well-formed files of every kind that is decoded, from which mutations start."""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

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
        made["gif"] = (make_video(folder / "v.gif", frames, "gif", "rgb8"),)
        made["zip"] = (make_zip(folder / "v.zip", png_frames(3, *SIZE)),)
        made["shot"] = (make_zip(folder / "shot.zip", dict(shot_files(scene("shapes", SIZE, frames=2)))),)
        made["exr"] = tuple(_exr(folder / f"{half}.exr", half) for half in (False, True))
        found = {kind: tuple(path.read_bytes() for path in paths) for kind, paths in made.items()}
    return found | {kind: (_still(f".{kind}"), _still(f".{kind}", gray=True)) for kind in ("png", "jpg", "webp")}


def _exr(path: Path, half: bool) -> Path:
    plane = np.linspace(0, 1, SIZE[0] * SIZE[1], dtype=np.float32).reshape(SIZE[1], SIZE[0])
    write_exr(path, {"R": plane, "G": plane, "B": plane, "Vector.X": plane}, half)
    return path


def _still(extension: str, gray: bool = False) -> bytes:
    image = picture(3, *SIZE)
    done, data = cv2.imencode(extension, image[..., 0] if gray else image)
    assert done
    return io.BytesIO(data.tobytes()).getvalue()
