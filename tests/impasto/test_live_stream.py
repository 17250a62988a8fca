"""What `impasto live` is made of: pace, times of what is written, words; and the command as a script sees it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import httpx
import numpy as np
import pytest

from impasto.cli.app import run as command
from impasto.live.run import Stream
from impasto.live.sinks import TICKS, open_sink
from impasto.live.sources import FileSource, open_source
from impasto.live.wire import Answer
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.video.reader import VideoReader
from tests.conftest import TINY_FRAMES, TINY_HEIGHT, TINY_WIDTH
from tests.impasto.test_live_client import served, until

SIZE = (TINY_WIDTH, TINY_HEIGHT)


class Reel:
    """A source of flat frames at given times."""

    size, paced, sound, skipped = (32, 16), False, None, 0

    def __init__(self, times: list[float], fps: float = 10.0) -> None:
        self.times, self.fps = times, fps

    def __iter__(self) -> Iterator[tuple[float, Frame]]:
        for number, when in enumerate(self.times):
            yield when, np.full((16, 32, 3), 10 * number, np.uint8)

    def close(self) -> None:
        """Nothing is open."""


class Mirror:
    """A client that answers at once, but not to what is in `drops`."""

    def __init__(self, drops: tuple[int, ...] = ()) -> None:
        self.sent: list[tuple[float, Frame]] = []
        self.drops, self.closed = drops, False
        self.began = time.monotonic()

    @property
    def next_sequence(self) -> int:
        return len(self.sent)

    def send(self, frame: Frame) -> int:
        self.sent.append((time.monotonic() - self.began, frame))
        return len(self.sent) - 1

    def answers(self, wait_s: float | None = None) -> Iterator[Answer]:
        given = 0
        while not self.closed or given < len(self.sent):
            if given == len(self.sent):
                time.sleep(0.001)
                continue
            if given not in self.drops:
                stamp = time.monotonic_ns() // 1000
                yield Answer(given, stamp, (32, 16), True, 2000, bytes([given]))
            given += 1

    def picture(self, answer: Answer) -> Frame:
        return self.sent[answer.sequence][1]

    def close(self) -> None:
        self.closed = True


class Shelf:
    """A sink that keeps what it gets."""

    def __init__(self, enough: int = 1000) -> None:
        self.frames: list[tuple[float, int]] = []
        self.enough, self.end_s = enough, -1.0

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> bool:
        self.frames.append((when_s, int(frame[0, 0, 0])))
        return len(self.frames) < self.enough

    def finish(self, end_s: float) -> str:
        self.end_s = end_s
        return "shelf"


def stream(client: Mirror, source: Reel, sink: Any, **more: Any) -> Stream:
    return Stream(client, source, sink, **more)  # type: ignore[arg-type]


def test_frames_are_sent_at_their_times() -> None:
    client, shelf = Mirror(), Shelf()
    made = stream(client, Reel([0.0, 0.1, 0.15, 0.4]), shelf)
    assert made.run() == "shelf"
    sent = [when for when, _ in client.sent]
    assert np.allclose(np.diff(sent), [0.1, 0.05, 0.25], atol=0.04)
    assert shelf.frames == [(0.0, 0), (0.1, 10), (0.15, 20), (0.4, 30)]
    assert shelf.end_s == pytest.approx(0.5)
    assert made.tally.as_json() | {"seconds": 0, "fps": 0} == {
        "frames": 4, "painted": 4, "dropped": 0, "late": 0, "fps": 0, "seconds": 0,
        "server_latency_ms": {"p50": pytest.approx(2, rel=0.03), "p95": pytest.approx(2, rel=0.03),
                              "p99": pytest.approx(2, rel=0.03)},
        "round_trip_ms": made.tally.as_json()["round_trip_ms"],
    }  # fmt: skip


def test_a_reader_that_is_late_drops_as_a_camera_would() -> None:
    ticks = iter([0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    client = Mirror()
    made = stream(client, Reel([0.0, 0.1, 0.2, 0.45, 0.5]), Shelf(), clock=lambda: next(ticks))
    made.run()
    assert [int(frame[0, 0, 0]) for _, frame in client.sent] == [0, 30, 40]
    assert made.tally.late == 2


def test_it_ends_with_the_duration_and_when_the_sink_has_enough() -> None:
    client = Mirror()
    stream(client, Reel([0.0, 0.01, 0.02, 0.03]), Shelf(), duration_s=0.02).run()
    assert len(client.sent) == 2
    shelf = Shelf(enough=2)
    stream(Mirror(), Reel([n / 50 for n in range(100)], fps=50), shelf).run()
    assert len(shelf.frames) == 2


def test_a_frame_that_was_dropped_leaves_the_one_before_on_screen(tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    source = Reel([0.0, 0.04, 0.08, 0.2, 0.24], fps=25)
    made = stream(Mirror(drops=(1, 3)), source, open_sink(str(out), source, 20))
    assert made.run() == str(out)
    assert made.tally.as_json()["dropped"] == 2
    with VideoReader(out) as reader:
        times = [float(t * reader.time_base) for t in reader.timestamps]
        end_s = float(reader.index.end * reader.time_base)
        levels = [int(frame.mean()) for frame in reader.read()]
    assert times == pytest.approx([0.0, 0.08, 0.24], abs=2 / TICKS)
    assert end_s == pytest.approx(0.28, abs=0.001)
    assert levels == pytest.approx([0, 20, 40], abs=3)


def test_a_file_keeps_its_times_and_goes_round(tiny_clip: Path) -> None:
    with VideoReader(tiny_clip) as reader:
        times = [float((t - reader.timestamps[0]) * reader.time_base) for t in reader.timestamps]
        length = float((reader.index.end - reader.timestamps[0]) * reader.time_base)
    source = FileSource(tiny_clip, 2, None)
    seen = [when for when, _ in source]
    source.close()
    assert seen == pytest.approx([*times, *(length + t for t in times)])
    assert source.sound is None


def test_a_source_can_be_scaled(tiny_clip: Path) -> None:
    source = open_source(str(tiny_clip), 1, (48, 32), None)
    assert next(iter(source))[1].shape == (32, 48, 3) and source.size == (48, 32)
    source.close()


@pytest.mark.parametrize(
    ("words", "field"),
    [(["--input", "no.mp4"], "--input"), (["--input", "camera:x"], "--input"), (["--input", "camera:77"], "--input"),
     ([], "--input"), (["--input", "a.mp4", "--input", "b.mp4"], "--input"),
     (["--input", "CLIP", "--size", "big"], "--size"), (["--input", "CLIP", "--codec", "av1"], "--codec"),
     (["--input", "CLIP", "--output", "x.gif"], "--output"), (["--input", "CLIP", "--output", "x.png"], "--output"),
     (["--input", "CLIP", "--output", "rtmp://127.0.0.1:9/x"], "--output")],
)  # fmt: skip
def test_bad_words_are_refused_before_anything_starts(
    words: list[str], field: str, tiny_clip: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = command(["live", *(str(tiny_clip) if word == "CLIP" else word for word in words), "--json"])
    said = capsys.readouterr()
    assert status == 2, said
    if words:
        assert json.loads(said.out.splitlines()[-1])["error"]["field"] == field


def test_a_window_shows_and_quits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    window = open_sink("window", Reel([0.0]), 20)
    picture = np.full((16, 32, 3), 200, np.uint8)
    assert window.put(0.0, picture, picture)
    assert pygame.display.get_surface().get_at((16, 8))[:3] == (200, 200, 200)
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_q))
    assert not window.put(0.1, picture, None)
    assert window.finish(1.0) == "window"


def test_a_stream_cannot_be_one_picture(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="not one picture"):
        open_sink(str(tmp_path / "x.png"), Reel([0.0]), 20)


# -- the command, with a service of its own


def live(*words: str | Path) -> list[str]:
    return [sys.executable, "-m", "impasto", "live", *map(str, words), "--json"]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No service on this machine is used, whatever runs here."""
    monkeypatch.setattr("impasto.live.service._answers", lambda address: False)


def test_a_clip_goes_through_a_service_started_for_it_and_keeps_its_sound(
    alone: None, tiny_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.mp4"
    words = ["live", "--input", str(tiny_clip), "--output", str(out), "--param", "lines=off", "--json"]
    assert command(words) == 0
    said = capsys.readouterr()
    summary = json.loads(said.out.splitlines()[-1])
    assert (summary["frames"], summary["width"], summary["height"]) == (TINY_FRAMES, *SIZE)
    assert 0 < summary["painted"] == summary["frames"] - summary["dropped"]
    assert set(summary["server_latency_ms"]) == set(summary["round_trip_ms"]) == {"p50", "p95", "p99"}
    assert summary["output"] == str(out) and "is started" in said.err
    with av.open(str(out)) as file:
        assert len(file.streams.audio) == 1
        assert len(list(file.decode(video=0))) == summary["painted"]


def test_ctrl_c_ends_in_order(tiny_clip: Path, tmp_path: Path, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.mp4"
    with served(home, monkeypatch) as url:
        words = live("--input", tiny_clip, "--loop", "0", "--output", out, "--server", url, "--method", "echo")
        child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            until(lambda: httpx.get(f"{url}/v1/live").json()["sessions"], 60)
            time.sleep(1)
            child.send_signal(signal.SIGINT)
            said, _ = child.communicate(timeout=60)
        finally:
            child.kill()
    summary = json.loads(said.splitlines()[-1])
    assert child.returncode == 0, said
    assert summary["painted"] > 0
    with VideoReader(out) as reader:
        assert reader.frames == summary["painted"]
