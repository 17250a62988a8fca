"""Stylise by example, two ways, with nothing to download.

    python examples/analogy.py layers               a scene with exact velocities, four layers, each in its own style
    python examples/analogy.py keyframe [CLIP]      one painted frame, propagated through a clip (or a scene of ours)

Both write their inputs to ./analogy/ and then run the `impasto render` command that they print. Another of our methods
makes the paintings; replace them with your own files and run the command again.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from impasto.cli.app import run
from pipeline.frames import Frame
from pipeline.methods.multistyle import MultistyleParams, MultistyleSession
from pipeline.scenes import scene
from pipeline.scenes.shot import shot_files
from pipeline.video.reader import VideoReader
from pipeline.video.stills import encode_png

FOLDER = Path("analogy")
SIZE, FRAMES = (480, 270), 12
LAYERS = {
    "1 sky": ("sky", "sun", "clouds", "gull", "far gull"),
    "2 hills": ("far hills", "near hills", "rock", "house", "lighthouse"),
    "3 sea": ("sea", "far boat", "boat"),
    "4 shore": ("tree", "bank", "jetty", "flowers"),
}
STYLES = {"1 sky": "van-gogh", "2 hills": "watercolor", "3 sea": "impressionism", "4 shore": "expressionism"}


def layers() -> list[str]:
    """Write the inputs of a shot; the command that renders it."""
    made = scene("harbour", SIZE, frames=FRAMES)
    shot = FOLDER / "shot"
    _write(shot, shot_files(made, LAYERS))
    for layer, style in STYLES.items():
        _write(shot / "layers" / layer / "style", _pair(made.image(0), style))
    return [str(shot), "-o", str(FOLDER / "layers.mp4")]


def keyframe(clip: Path | None) -> list[str]:
    """Paint one frame of a clip; the command that propagates it to the other frames."""
    frames = _first_frames(clip)
    source = FOLDER / "frames"
    _write(source, ((f"{index:04d}.png", encode_png(frame)) for index, frame in enumerate(frames)))
    _write(FOLDER / "keys", [("0000.png", encode_png(_painted(frames[0], "van-gogh")))])
    return [str(source), "-o", str(FOLDER / "keyframe.mp4"), "--input", f"keyframes={FOLDER / 'keys'}"]


def _first_frames(clip: Path | None) -> list[Frame]:
    if clip is None:
        made = scene("portrait", SIZE, frames=FRAMES)
        return [made.image(index) for index in range(FRAMES)]
    with VideoReader(clip) as reader:
        return list(reader.read(0, FRAMES))


def _pair(plain: Frame, style: str) -> Iterable[tuple[str, bytes]]:
    return [("input.png", encode_png(plain)), ("output.png", encode_png(_painted(plain, style)))]


def _painted(plain: Frame, style: str) -> Frame:
    params = MultistyleParams.model_validate({"style": style})
    return MultistyleSession(params, (plain.shape[1], plain.shape[0])).step(plain)


def _write(folder: Path, files: Iterable[tuple[str, bytes]]) -> None:
    for name, data in files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def main() -> None:
    what = sys.argv[1] if len(sys.argv) > 1 else "layers"
    if what not in ("layers", "keyframe"):
        sys.exit(__doc__)
    rest = layers() if what == "layers" else keyframe(Path(sys.argv[2]) if len(sys.argv) > 2 else None)
    command = ["render", *rest, "--method", "analogy"]
    print("impasto", *(f"'{part}'" if " " in part else part for part in command), flush=True)
    sys.exit(run(command))


if __name__ == "__main__":
    main()
