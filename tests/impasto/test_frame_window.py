"""A job on a piece of a video gives the bytes of the same job on a video that is only that piece."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.shot_files import files_of_frames
from tests.conftest import TINY_FPS
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.jobs.frame_window import WindowImages, window_info
from workers.settings import FarmSettings

PIECE = (6, 14)


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("window"), pool="local", workers=2))
    opened.start()
    yield opened
    opened.stop()


def rendered(farm: Farm, request: JobRequest) -> bytes:
    job, last_seq = farm.jobs.submit(request), 0
    while not farm.jobs.get(job.id).state.final:
        farm.jobs.wait_for_event(job.id, last_seq, 5.0)
        last_seq = max((event.seq for event in farm.jobs.events(job.id, last_seq)[0]), default=last_seq)
    assert farm.jobs.get(job.id).state == "succeeded", farm.jobs.get(job.id).error
    return b"".join(farm.files.read(farm.files.get(job.id, "result")))


def added(farm: Farm, folder: Path, name: str, data: bytes) -> str:
    (folder / name).write_bytes(data)
    return farm.assets.add(folder / name, name).id


def zipped(entries: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return out.getvalue()


def frames_as_zip(video: Path, start: int, stop: int) -> bytes:
    with VideoReader(video) as reader:
        frames = list(reader.read(start, stop))
    return zipped({f"{k:04d}.png": cv2.imencode(".png", f[..., ::-1])[1].tobytes() for k, f in enumerate(frames)})


def key_of(value: int) -> bytes:
    return bytes(cv2.imencode(".png", np.full((64, 96, 3), value, np.uint8))[1].tobytes())


def drawn(method: str, first: int) -> dict[str, bytes]:
    """Inputs that number frames, as for a video whose frame 0 is frame `first` of the clip."""
    polygon = {"frame": 7 - first, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}
    keys = [{"region": "left", "frame": 9 - first, "style": "pointillism"}]
    design = {"version": 1, "regions": {"left": {"polygons": [polygon]}}, "keys": keys}
    return {
        "analogy": {"keyframes": zipped({f"{9 - first:04d}.png": key_of(180)})},
        "multistyle": {"design": json.dumps(design).encode()},
    }.get(method, {})


@pytest.mark.parametrize("method", ["abstraction", "analogy", "multistyle", "patches"])
def test_a_frame_range_has_the_bytes_of_the_cut_clip(farm: Farm, tiny_clip: Path, tmp_path: Path, method: str) -> None:
    films = []
    for first, video in ((0, frames_as_zip(tiny_clip, 0, 24)), (PIECE[0], frames_as_zip(tiny_clip, *PIECE))):
        files = {"video": video, **drawn(method, first)}
        names = {"design": "design.json"}
        ids = {name: added(farm, tmp_path, names.get(name, f"{name}-{first}.zip"), files[name]) for name in files}
        frames = PIECE if first == 0 else None
        films.append(rendered(farm, JobRequest(method, ids, seed=3, output=OutputSpec("png"), frames=frames)))
    piece, cut = (zipfile.ZipFile(io.BytesIO(film)) for film in films)
    assert piece.namelist() == [f"{k:04d}.png" for k in range(*PIECE)], "frames keep the numbers of the source"
    assert cut.namelist() == [f"{k:04d}.png" for k in range(8)]
    assert [piece.read(name) for name in piece.namelist()] == [cut.read(name) for name in cut.namelist()]


def test_the_film_of_a_frame_range_has_its_sound(farm: Farm, tiny_clip: Path, tmp_path: Path) -> None:
    request = JobRequest("abstraction", {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}, frames=PIECE)
    film = tmp_path / "piece.mp4"
    film.write_bytes(rendered(farm, request))
    assert probe(film).frames == 8
    with av.open(str(film)) as container:
        (sound,) = container.streams.audio
        played = [packet for packet in container.demux(sound) if packet.pts is not None]
        assert sound.time_base is not None
        end_s = float(max((packet.pts or 0) + (packet.duration or 0) for packet in played) * sound.time_base)
    assert end_s == pytest.approx(8 / TINY_FPS, abs=0.05)


@pytest.mark.parametrize("frames", [(5, 5), (3, 99)])
def test_a_frame_range_outside_the_video_is_refused(farm: Farm, tiny_clip: Path, frames: tuple[int, int]) -> None:
    video = farm.assets.add(tiny_clip, "tiny.mp4").id
    with pytest.raises(Exception, match="24 frames"):
        farm.jobs.submit(JobRequest("abstraction", {"video": video}, frames=frames))


def test_images_and_media_info_of_a_frame_range() -> None:
    images: Any = WindowImages({2: "a", 6: "b", 13: "c", 14: "d"}, PIECE)
    assert dict(images) == {0: "b", 7: "c"}
    assert 8 not in images
    facts = window_info({"frames": 24, "duration_s": 2.0, "width": 96}, PIECE)
    assert facts == {"frames": 8, "duration_s": pytest.approx(2 / 3), "width": 96}


def test_files_of_a_shot_are_limited_to_the_frame_range() -> None:
    names = ["shot.json", "style/output.png"]
    names += [f"{folder}/{k:04d}.exr" for folder in ("frames", "layers/sky/masks", "guides/depth") for k in range(1, 6)]
    kept = set(files_of_frames(dict.fromkeys(names, b""), 1, 3))
    numbered = {f"{folder}/{k:04d}.exr" for folder in ("frames", "layers/sky/masks", "guides/depth") for k in (2, 3)}
    assert kept == {"shot.json", "style/output.png"} | numbered
    assert set(files_of_frames({"a_10.exr": b"", "a_12.exr": b"", "a_14.exr": b""}, 1, 9)) == {"a_12.exr", "a_14.exr"}
