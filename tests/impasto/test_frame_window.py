"""A job on a piece of a film gives the frames of the film."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pipeline.video.probe import probe
from tests.conftest import TINY_FPS
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.jobs.frame_window import video_info, window_info
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


def key_of(value: int) -> bytes:
    return bytes(cv2.imencode(".png", np.full((64, 96, 3), value, np.uint8))[1].tobytes())


def drawn() -> dict[str, dict[str, bytes]]:
    """Inputs with a time, before, in and after the piece."""
    polygon = {"frame": 2, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}
    styles = [(0, {"hue": 0}), (20, {"hue": 120})]
    keys = [{"region": "rest", "frame": frame, "set": values} for frame, values in styles]
    keys.append({"region": "left", "frame": 3, "style": "pointillism"})
    design = {"version": 1, "regions": {"left": {"polygons": [polygon]}}, "keys": keys}
    mask = np.zeros((64, 96), np.uint8)
    mask[:, :48] = 255
    return {
        "abstraction": {"importance": zipped({"0001.png": cv2.imencode(".png", mask)[1].tobytes()})},
        "analogy": {"keyframes": zipped({"0001.png": key_of(180), "0020.png": key_of(90)})},
        "multistyle": {"design": json.dumps(design).encode()},
    }


@pytest.mark.parametrize("method", ["abstraction", "analogy", "multistyle"])
def test_a_piece_has_the_bytes_of_the_film(farm: Farm, tiny_clip: Path, tmp_path: Path, method: str) -> None:
    """Keys, masks, outlines and changing styles apply at the film's time. The film is shorter than the preroll."""
    ids = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}
    for name, data in drawn()[method].items():
        ids[name] = added(farm, tmp_path, f"{name}.json" if name == "design" else f"{name}.zip", data)
    requests = [JobRequest(method, ids, seed=3, output=OutputSpec("png"), frames=frames) for frames in (None, PIECE)]
    film, piece = (zipfile.ZipFile(io.BytesIO(rendered(farm, request))) for request in requests)
    assert piece.namelist() == [f"{k:04d}.png" for k in range(*PIECE)], "frames keep the numbers of the source"
    assert [piece.read(name) for name in piece.namelist()] == [film.read(name) for name in piece.namelist()]


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


def test_media_info_of_a_frame_range() -> None:
    facts = window_info({"frames": 24, "duration_s": 2.0, "width": 96}, PIECE)
    assert facts == {"frames": 8, "duration_s": pytest.approx(2 / 3), "width": 96, "first": 6, "film": 24}
    with_lead = video_info(facts, lead=10)
    assert (with_lead.first, with_lead.frames, with_lead.lead, with_lead.total) == (0, 14, 6, 24)
    assert [frame for frame in range(24) if with_lead.delivers(frame)] == list(range(*PIECE))
