"""A finished film converted by a real farm: the film's frames, the source's times, reproducible bytes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from tests.pipeline.video.making import make_video, picture
from workers.contract.record import Job
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

FRAMES = 20
SIZE = (97, 63)


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("exports"), pool="local", workers=2))
    opened.start()
    yield opened
    opened.stop()


@pytest.fixture(scope="module")
def video(farm: Farm, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("source") / "clip.mkv"
    frames = [picture(i, *SIZE) for i in range(FRAMES)]
    make_video(path, frames, codec="ffv1", pixel_format="bgr0", click_s=[0.2])
    return farm.assets.add(path, path.name).id


def finished(farm: Farm, job: Job) -> Job:
    last_seq = 0
    while not farm.jobs.get(job.id).state.final:
        farm.jobs.wait_for_event(job.id, last_seq, 5.0)
        last_seq = max((event.seq for event in farm.jobs.events(job.id, last_seq)[0]), default=last_seq)
    done = farm.jobs.get(job.id)
    assert done.state == "succeeded", done.error
    return done


def film(farm: Farm, video: str, **more: object) -> Job:
    request = JobRequest("abstraction", {"video": video}, {"lines": "off"}, name="my cat", **more)  # type: ignore[arg-type]
    return finished(farm, farm.jobs.submit(request))


def saved(farm: Farm, job: Job, folder: Path) -> Path:
    stored = farm.files.get(job.id, "result")
    path = folder / stored.filename
    path.write_bytes(b"".join(farm.files.read(stored)))
    return path


def frames_of(path: Path) -> list[Frame]:
    with VideoReader(path) as reader:
        return list(reader.read())


@pytest.mark.parametrize("form", ["mp4", "webm", "png", "gif"])
def test_an_export_has_the_film_s_frames_and_the_same_bytes_again(
    form: str, farm: Farm, video: str, tmp_path: Path
) -> None:
    source = film(farm, video, output=OutputSpec("png"), frames=(4, 16))
    given = frames_of(saved(farm, source, tmp_path))
    first = finished(farm, farm.exports.make(source.id, OutputSpec(form, 10)))
    path = saved(farm, first, tmp_path)
    got = frames_of(path)
    assert path.name == f"my-cat.{'zip' if form == 'png' else form}"
    assert len(got) == len(given) == 12
    worst = max(np.abs(a[:63, :97].astype(int) - b).mean() for a, b in zip(got, given, strict=True))
    assert worst == 0 if form == "png" else worst < 6
    if form in ("mp4", "webm"):
        assert probe(path).has_audio
    bytes_before = path.read_bytes()
    farm.jobs.delete(first.id)
    again = finished(farm, farm.exports.make(source.id, OutputSpec(form, 10)))
    assert again.id != first.id and saved(farm, again, tmp_path).read_bytes() == bytes_before


def test_frames_of_a_padded_film_have_the_source_s_size(farm: Farm, video: str, tmp_path: Path) -> None:
    """H.264 adds a row and a column to 97 x 63."""
    source = film(farm, video)
    export = finished(farm, farm.exports.make(source.id, OutputSpec("png")))
    padded, cut = frames_of(saved(farm, source, tmp_path)), frames_of(saved(farm, export, tmp_path))
    assert (padded[0].shape, cut[0].shape) == ((64, 98, 3), (63, 97, 3))
    assert all(np.array_equal(a[:63, :97], b) for a, b in zip(padded, cut, strict=True))


def test_a_gif_is_scaled_to_720_px_and_keeps_its_times(tmp_path: Path, farm: Farm) -> None:
    path = tmp_path / "wide.mp4"
    wide = [cv2.resize(picture(i), (1440, 96)) for i in range(25)]
    make_video(path, wide, pts=[2 * i for i in range(25)])
    asset = farm.assets.add(path, path.name)
    source = film(farm, asset.id)
    export = finished(farm, farm.exports.make(source.id, OutputSpec("gif")))
    with VideoReader(saved(farm, export, tmp_path)) as reader, VideoReader(path) as original:
        assert reader.size == (720, 48)
        shown = [float(t * reader.time_base) for t in reader.timestamps]
        meant = [float((t - original.timestamps[0]) * original.time_base) for t in original.timestamps]
    assert shown == pytest.approx(meant, abs=0.0051)
