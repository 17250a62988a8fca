"""Parts of `impasto live`: pacing, output timestamps, arguments; and the command run as a process."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import av
import cv2
import httpx
import numpy as np
import psutil
import pytest

from impasto import LiveClient
from impasto.cli.app import run as command
from impasto.live.broadcast import OutputLost
from impasto.live.plain_sinks import open_sink
from impasto.live.run import LiveStream
from impasto.live.sink import Sink
from impasto.live.sources import FileSource, SourceLost, open_source
from impasto.live.wire import Answer
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.video.reader import VideoReader
from pipeline.video.stills import encode_png
from tests.conftest import TINY_FRAMES, TINY_HEIGHT, TINY_WIDTH
from tests.impasto.live_service import only_echo, served
from tests.service.whip_server import whip_server
from tests.waiting import until

SIZE = (TINY_WIDTH, TINY_HEIGHT)


class Reel:
    """A source of flat frames at given times."""

    size, paced, sound, skipped = (32, 16), False, None, 0

    def __init__(self, times: list[float], fps: float = 10.0) -> None:
        self.times, self.fps = times, fps

    def __iter__(self) -> Iterator[tuple[float, Frame]]:
        for number, when in enumerate(self.times):
            yield when, np.full((16, 32, 3), 10 * number, np.uint8)

    def stop(self) -> None:
        """Do nothing: frames are not paced."""

    def close(self) -> None:
        """Do nothing: there is nothing to close."""


class Mirror:
    """A client that answers at once, except frames in `drops`."""

    def __init__(self, drops: tuple[int, ...] = ()) -> None:
        self.sent: list[tuple[float, Frame]] = []
        self.drops, self.closed, self.given = drops, False, 0
        self.began = time.monotonic()

    @property
    def next_sequence(self) -> int:
        return len(self.sent)

    @property
    def ended(self) -> bool:
        return self.closed and self.given == len(self.sent)

    def send(self, frame: Frame) -> int:
        self.sent.append((time.monotonic() - self.began, frame))
        return len(self.sent) - 1

    def answers(self, wait_s: float) -> Iterator[Answer]:
        time.sleep(min(wait_s, 0.001))
        while self.given < len(self.sent):
            self.given += 1
            if self.given - 1 not in self.drops:
                stamp = time.monotonic_ns() // 1000
                yield Answer(self.given - 1, stamp, (32, 16), True, 2000, b"painted")

    def picture(self, answer: Answer) -> Frame:
        return self.sent[answer.sequence][1]

    def close(self) -> None:
        self.closed = True


class FrameList(Sink):
    """A sink that collects its frames."""

    def __init__(self, enough: int = 1000, needs_original: bool = False) -> None:
        self.frames: list[tuple[float, int]] = []
        self.originals: list[Frame | None] = []
        self.enough, self.needs_original, self.end_s = enough, needs_original, -1.0

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        self.frames.append((when_s, int(frame[0, 0, 0])))
        self.originals.append(original)

    def is_open(self) -> bool:
        return len(self.frames) < self.enough

    def finish(self, end_s: float) -> str:
        self.end_s = end_s
        return "label"


def stream(client: Mirror, source: Any, sink: Sink, **more: Any) -> LiveStream:
    return LiveStream(client, source, sink, **more)  # type: ignore[arg-type]


# -- pace


def test_frames_are_sent_at_their_times() -> None:
    client, frame_list = Mirror(), FrameList()
    made = stream(client, Reel([0.0, 0.1, 0.15, 0.4]), frame_list)
    assert made.run() == "label"
    sent = [when for when, _ in client.sent]
    assert np.allclose(np.diff(sent), [0.1, 0.05, 0.25], atol=0.04)
    assert frame_list.frames == [(0.0, 0), (0.1, 10), (0.15, 20), (0.4, 30)]
    assert frame_list.end_s == pytest.approx(0.5)
    figures = made.tally.as_json()
    assert figures["server_latency_ms"] == pytest.approx({"p50": 2, "p95": 2, "p99": 2}, rel=0.03)
    assert set(figures["round_trip_ms"]) == {"p50", "p95", "p99"}
    assert [figures[name] for name in ("frames", "painted", "dropped", "late")] == [4, 4, 0, 0]
    assert figures["seconds"] == pytest.approx(0.4, abs=0.05)


def test_a_late_reader_drops_frames_like_a_camera() -> None:
    ticks = iter([0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    client = Mirror()
    made = stream(client, Reel([0.0, 0.1, 0.2, 0.45, 0.5]), FrameList(), clock=lambda: next(ticks))
    made.run()
    assert [int(frame[0, 0, 0]) for _, frame in client.sent] == [0, 30, 40]
    assert made.tally.late == 2


def test_the_stream_ends_at_the_duration_or_when_the_sink_is_full() -> None:
    client = Mirror()
    stream(client, Reel([0.0, 0.01, 0.02, 0.03]), FrameList(), duration_s=0.02).run()
    assert len(client.sent) == 2
    client = Mirror()
    stream(client, Reel([n / 50 for n in range(100)], fps=50), FrameList(enough=2)).run()
    assert 2 <= len(client.sent) < 50


def test_the_stream_can_be_stopped_while_it_waits_for_a_frame() -> None:
    made = stream(Mirror(), Reel([0.0, 60.0]), FrameList())
    threading.Timer(0.2, made.stop).start()
    began = time.monotonic()
    assert made.run() == "label"
    assert time.monotonic() - began < 5


def test_a_source_that_breaks_is_reported_after_the_sink_is_finished() -> None:
    class Broken(Reel):
        def __iter__(self) -> Iterator[tuple[float, Frame]]:
            yield from super().__iter__()
            raise OSError("unplugged")

    frame_list = FrameList()
    with pytest.raises(OSError, match="unplugged"):
        stream(Mirror(), Broken([0.0, 0.01]), frame_list).run()
    assert len(frame_list.frames) == 2 and frame_list.end_s > 0


def test_originals_are_kept_only_for_a_sink_that_shows_them() -> None:
    kept, shown = FrameList(), FrameList(needs_original=True)
    stream(Mirror(), Reel([0.0, 0.01]), kept).run()
    stream(Mirror(drops=(1,)), Reel([0.0, 0.01, 0.02]), shown).run()
    assert kept.originals == [None, None]
    assert [int(original[0, 0, 0]) for original in shown.originals if original is not None] == [0, 20]


# -- what is written


def times_of(path: Path) -> tuple[list[float], float, list[int]]:
    """(time of each frame, end of the last, mean level of each), seconds."""
    with VideoReader(path) as reader:
        times = [float(t * reader.time_base) for t in reader.timestamps]
        return times, float(reader.index.end * reader.time_base), [int(frame.mean()) for frame in reader.read()]


@pytest.mark.parametrize("name", ["out.mp4", "out.webm"])
def test_a_dropped_frame_leaves_the_previous_one_visible(tmp_path: Path, name: str) -> None:
    out = tmp_path / "new" / name
    source = Reel([0.0, 0.04, 0.08, 0.2, 0.24], fps=25)
    made = stream(Mirror(drops=(1, 3)), source, open_sink(str(out), source, 20))
    assert made.run() == str(out)
    assert made.tally.as_json()["dropped"] == 2
    times, end_s, levels = times_of(out)
    assert times == pytest.approx([0.0, 0.08, 0.24], abs=0.001)
    assert end_s == pytest.approx(0.28, abs=0.001) or name == "out.webm"  # which does not say
    assert levels == pytest.approx([0, 20, 40], abs=3)
    assert [path.name for path in out.parent.iterdir()] == [name]


def test_the_last_picture_is_repeated_for_dropped_final_frames(tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    source = Reel([n / 50 for n in range(10)], fps=50)
    stream(Mirror(drops=(5, 6, 7, 8, 9)), source, open_sink(str(out), source, 20)).run()
    times, end_s, _ = times_of(out)
    assert (len(times), end_s) == (5, pytest.approx(0.2, abs=0.001))


def test_answers_of_a_lower_resolution_are_upscaled(tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    sink = open_sink(str(out), Reel([]), 20)
    sink.put(0.0, np.full((16, 32, 3), 50, np.uint8), None)
    sink.put(0.1, np.full((8, 16, 3), 150, np.uint8), None)
    sink.finish(0.2)
    with VideoReader(out) as reader:
        frames = list(reader.read())
    assert [frame.shape for frame in frames] == [(16, 32, 3)] * 2
    assert [int(frame.mean()) for frame in frames] == pytest.approx([50, 150], abs=3)


@pytest.mark.parametrize("name", ["out.mp4", "frames/"])
def test_without_an_answer_nothing_is_written(tmp_path: Path, name: str) -> None:
    source = Reel([0.0, 0.01])
    made = stream(Mirror(drops=(0, 1)), source, open_sink(f"{tmp_path}/{name}", source, 20))
    assert made.run() == ""
    assert made.tally.as_json()["fps"] == 0
    assert list(tmp_path.iterdir()) == []


def test_numbered_frames_replace_an_earlier_run_on_completion(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(5):
        (folder / f"{number:04d}.png").write_bytes(b"old")
    sink = open_sink(f"{folder}/", Reel([]), 20)
    picture = np.full((16, 32, 3), 70, np.uint8)
    sink.put(0.0, picture, None)
    sink.put(0.1, picture, None)
    assert len(list(folder.iterdir())) == 5
    assert sink.finish(0.2) == str(folder)
    assert sorted(path.name for path in folder.iterdir()) == ["0000.png", "0001.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


# -- sound


def sound_of(path: Path) -> tuple[float, float]:
    """(begin, end) of the sound, seconds."""
    with av.open(str(path)) as file:
        packets = [packet for packet in file.demux(audio=0) if packet.pts is not None]
        last = packets[-1]
        return (
            float(packets[0].pts * packets[0].time_base),
            float((last.pts + (last.duration or 0)) * last.time_base),
        )


def film(clip: Path, out: Path, drops: tuple[int, ...] = (), duration_s: float = float("inf")) -> None:
    """The clip through a mirror, at once."""
    source = open_source(str(clip), 1, None, None)
    source.paced = True  # claims to be paced: frames are not delayed
    stream(Mirror(drops), source, open_sink(str(out), source, 20), duration_s=duration_s).run()
    source.close()


def test_the_whole_clip_keeps_its_sound(tiny_clip: Path, tmp_path: Path) -> None:
    film(tiny_clip, tmp_path / "out.mp4")
    assert sound_of(tmp_path / "out.mp4") == pytest.approx(sound_of(tiny_clip), abs=0.03)


def test_the_sound_of_a_shortened_stream_ends_with_its_pictures(tiny_clip: Path, tmp_path: Path) -> None:
    film(tiny_clip, tmp_path / "out.mp4", duration_s=0.9)
    _, end_s, _ = times_of(tmp_path / "out.mp4")
    assert end_s == pytest.approx(11 / 12, abs=0.001)
    assert sound_of(tmp_path / "out.mp4")[1] == pytest.approx(end_s, abs=0.05)


def test_the_sound_is_synchronous_for_a_nonzero_start_time(tiny_clip: Path, tmp_path: Path) -> None:
    late = tmp_path / "late.ts"
    with av.open(str(tiny_clip)) as source, av.open(str(late), "w", format="mpegts") as target:
        copies = {s.index: target.add_stream_from_template(s) for s in source.streams}
        for packet in source.demux():
            if packet.dts is not None:
                shift = round(0.5 / packet.time_base) if packet.stream.type == "video" else 0
                packet.pts, packet.dts, packet.stream = (
                    packet.pts + shift,
                    packet.dts + shift,
                    copies[packet.stream.index],
                )
                target.mux(packet)
    with VideoReader(late) as reader:
        first_s = float(reader.timestamps[0] * reader.time_base)
    assert first_s >= 0.5
    film(late, tmp_path / "out.mp4", drops=(0, 1, 2))
    begin, end = sound_of(tmp_path / "out.mp4")
    assert begin == pytest.approx(0.0, abs=0.05)
    assert end == pytest.approx(sound_of(late)[1] - first_s - 3 / 12, abs=0.05)


# -- sources


def test_a_file_source_keeps_its_timestamps_and_loops(tiny_clip: Path) -> None:
    with VideoReader(tiny_clip) as reader:
        times = [float((t - reader.timestamps[0]) * reader.time_base) for t in reader.timestamps]
        length = float((reader.index.end - reader.timestamps[0]) * reader.time_base)
    source = FileSource(tiny_clip, 2, None)
    received = [when for when, _ in source]
    source.close()
    assert received == pytest.approx([*times, *(length + t for t in times)])
    assert source.sound is None


def test_a_file_can_be_played_at_another_rate(tiny_clip: Path) -> None:
    source = FileSource(tiny_clip, 1, 48.0)
    assert [when for when, _ in source] == pytest.approx([n / 48 for n in range(TINY_FRAMES)])
    assert (source.fps, source.sound) == (48.0, None)
    source.close()


def test_a_source_can_be_scaled(tiny_clip: Path) -> None:
    source = open_source(str(tiny_clip), 1, (48, 32), None)
    assert next(iter(source))[1].shape == (32, 48, 3) and source.size == (48, 32)
    source.close()


@contextmanager
def sending(clip: Path, seconds_apart: float = 0.0) -> Iterator[str]:
    """The address of a sender of MPEG-TS over TCP."""
    data = clip.read_bytes()

    def serve() -> None:
        here, _ = listener.accept()
        with here, suppress(OSError):
            half = len(data) // 2
            here.sendall(data[:half])
            time.sleep(seconds_apart)
            here.sendall(data[half:])

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(5)


@pytest.fixture(scope="module")
def transport_stream(tiny_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ts") / "tiny.ts"
    with av.open(str(tiny_clip)) as source, av.open(str(path), "w", format="mpegts") as target:
        copy = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = copy
                target.mux(packet)
    return path


def test_a_network_stream_gives_the_newest_frame_and_counts_dropped_ones(transport_stream: Path) -> None:
    with sending(transport_stream) as address:
        source = open_source(address, 1, None, None)
        assert (source.size, source.paced, source.sound) == (SIZE, True, None)
        received = 0
        for when, frame in source:
            assert frame.shape == (TINY_HEIGHT, TINY_WIDTH, 3) and when >= 0
            received += 1
        source.close()
    assert received >= 1
    assert received + source.skipped == TINY_FRAMES


def test_a_network_stream_can_be_closed_at_any_time(transport_stream: Path) -> None:
    with sending(transport_stream, seconds_apart=1.5) as address:
        source = open_source(address, 1, None, None)
        next(iter(source))
        threading.Timer(0.2, source.stop).start()
        began = time.monotonic()
        list(source)
        assert time.monotonic() - began < 1
        source.close()


def test_a_failed_sender_is_reported_as_an_error(transport_stream: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> Frame:
        raise OSError("the cable is out")

    monkeypatch.setattr("impasto.live.sources.to_frame", fail)
    with sending(transport_stream) as address:
        source = open_source(address, 1, None, None)
        for _ in range(2):
            with pytest.raises(SourceLost, match="the cable is out"):
                list(source)
        source.close()


# -- words


@pytest.mark.parametrize(
    ("words", "field"),
    [(["--input", "no.mp4"], "--input"), (["--input", "camera:x"], "--input"), (["--input", "camera:77"], "--input"),
     ([], "--input"), (["--input", "a.mp4", "--input", "b.mp4"], "--input"),
     (["--input", "tcp://127.0.0.1:9"], "--input"),
     (["--input", "CLIP", "--size", "big"], "--size"), (["--input", "CLIP", "--codec", "av1"], "--codec"),
     (["--input", "CLIP", "--loop", "often"], "--loop"), (["--input", "CLIP", "--loop", "0"], "--loop"),
     (["--input", "CLIP", "--output", "x.zip"], "--output"),
     (["--input", "CLIP", "--output", "x.gif"], "--output"), (["--input", "CLIP", "--output", "x.png"], "--output"),
     (["--input", "CLIP", "--output", "rtmp://127.0.0.1:x/x"], "--output"),
     (["--input", "CLIP", "--output", "gopher://127.0.0.1/x"], "--output"),
     (["--input", "CLIP", "--output", "whip://127.0.0.1:9/x"], "--output"),
     (["--input", "CLIP", "--prefer", "fast"], "--prefer"),
     (["--input", "srt://127.0.0.1:9"], "--input"), (["--input", "CLIP", "--output", "srt://127.0.0.1:9"], "--output")],
)  # fmt: skip
def test_bad_arguments_of_live_are_refused_before_the_start(
    words: list[str], field: str, tiny_clip: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = command(["live", *(str(tiny_clip) if word == "CLIP" else word for word in words), "--json"])
    output = capsys.readouterr()
    assert status == 2, output
    if words:
        error = json.loads(output.out.splitlines()[-1])["error"]
        assert error["field"] == field and error["remedy"]


def test_a_window_shows_frames_and_closes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    window = open_sink("window", Reel([0.0]), 20)
    light, dark = np.full((16, 32, 3), 200, np.uint8), np.full((16, 32, 3), 20, np.uint8)

    def press(key: int) -> bool:
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))
        return window.is_open()

    def pixels(frame: Frame) -> list[int]:
        window.put(0.0, frame, dark)
        return [pygame.display.get_surface().get_at((x, 8))[0] for x in (8, 24)]

    assert window.needs_original and window.is_open()
    assert pixels(light) == [200, 200]
    assert press(pygame.K_s)
    assert pixels(light) == [20, 200]
    assert press(pygame.K_SPACE)
    assert pixels(dark) == [20, 200]
    assert not press(pygame.K_q)
    assert window.finish(1.0) == "window"


def test_a_window_without_its_package_explains_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(BadInput, match=r"impasto\[window\]"):
        open_sink("window", Reel([0.0]), 20)


def test_a_broadcast_can_be_played_from_the_start(tmp_path: Path) -> None:
    source = Reel([n / 25 for n in range(10)], fps=25)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        received: list[bytes] = []

        def take() -> None:
            here, _ = listener.accept()
            with here:
                while data := here.recv(1 << 16):
                    received.append(data)

        player = threading.Thread(target=take)
        player.start()
        address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        made = stream(Mirror(drops=(3,)), source, open_sink(address, source, 20))
        assert made.run() == address
        player.join(5)
    (tmp_path / "received.ts").write_bytes(b"".join(received))
    times, _, levels = times_of(tmp_path / "received.ts")
    assert np.diff(times) == pytest.approx([0.04, 0.04, 0.08, *[0.04] * 5], abs=0.002)
    assert levels == pytest.approx([0, 10, 20, 40, 50, 60, 70, 80, 90], abs=4)


def test_a_broadcast_server_that_closes_ends_the_stream() -> None:
    source = Reel([n / 100 for n in range(600)], fps=100)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        sink = open_sink(address, source, 20)
        here, _ = listener.accept()
        here.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # a reset
        here.close()
        with pytest.raises(OutputLost) as lost:
            stream(Mirror(), source, sink).run()
    assert lost.value.field == "--output"


@pytest.mark.parametrize("scheme", ["rtmp", "tcp"])
def test_a_broadcast_to_nobody_ends_with_a_reason(scheme: str) -> None:
    source = Reel([n / 100 for n in range(600)], fps=100)
    with pytest.raises(OutputLost, match="refused"):
        stream(Mirror(), source, open_sink(f"{scheme}://127.0.0.1:9/live/key", source, 20)).run()


def test_a_silent_server_blocks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("impasto.live.broadcast.SILENT_S", 1)
    source = Reel([n / 50 for n in range(25)], fps=50)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"rtmp://127.0.0.1:{listener.getsockname()[1]}/live/key"
        began = time.monotonic()
        with suppress(OutputLost):  # or it ends first
            stream(Mirror(), source, open_sink(address, source, 20)).run()
    assert time.monotonic() - began < 5


PLAYER = """
import sys, av
with av.open(sys.argv[1], options={"listen": "1"}, timeout=20) as file:
    count = 0
    try:
        for frame in file.decode(video=0):
            count += 1
            print(frame.width, frame.height, float(frame.pts * frame.time_base), flush=True)
    except OSError:
        pass  # the sender went
"""


@contextmanager
def rtmp_server() -> Iterator[tuple[str, Callable[[], str]]]:
    """The address of a server for one sender, and a function that gives the output of its player."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"rtmp://127.0.0.1:{free.getsockname()[1]}/live/key"
    child = subprocess.Popen([sys.executable, "-c", PLAYER, address], stdout=subprocess.PIPE, text=True)
    try:
        until(lambda: psutil.Process(child.pid).net_connections())
        yield address, lambda: child.communicate(timeout=20)[0]
    finally:
        child.kill()
        child.wait()


def test_rtmp_reaches_a_player() -> None:
    """FFmpeg's server takes one guest only."""
    source = Reel([n / 25 for n in range(25)], fps=25)
    with rtmp_server() as (address, received):
        assert stream(Mirror(drops=(3,)), source, open_sink(address, source, 20)).run() == address
        frames = [line.split() for line in received().splitlines()]
    assert {(width, height) for width, height, _ in frames} == {("32", "16")}
    assert [float(when) for *_, when in frames] == pytest.approx([n / 25 for n in range(25) if n != 3], abs=0.002)


def test_whip_reaches_a_server() -> None:
    with whip_server() as server:
        sink = open_sink(server.address, Reel([0.0]), 20)
        for number in range(200):
            sink.put(number / 50, np.full((16, 32, 3), 8 * (number % 32), np.uint8), None)
            time.sleep(0.02)
            if len(server.frames) > 20:
                break
        assert sink.finish(4.0) == server.address
        until(lambda: server.deleted)
    assert {(frame.width, frame.height) for frame in server.frames} == {(32, 16)}
    levels = {round(float(frame.to_ndarray(format="gray").mean()) / 8) for frame in server.frames}
    assert len(levels) > 5, "frame after frame"


def test_srt_is_refused_by_name_where_ffmpeg_lacks_it() -> None:
    with pytest.raises(BadInput) as refused:
        open_sink("srt://127.0.0.1:9?timeout=1000", Reel([0.0]), 20)
    assert refused.value.field == "--output"
    if "without SRT" in refused.value.message:
        assert "libsrt" in refused.value.remedy


# -- the command, with a service of its own


def live(*words: str | Path) -> list[str]:
    return [sys.executable, "-m", "impasto", "live", *map(str, words), "--json"]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No service on this machine is used, whatever runs here."""
    monkeypatch.setattr("impasto.live.service._answers", lambda address: False)


def test_a_clip_streamed_through_a_temporary_service_keeps_its_sound(
    alone: None, tiny_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.mp4"
    words = ["live", "--input", str(tiny_clip), "--output", str(out), "--param", "lines=off", "--json"]
    assert command(words) == 0
    output = capsys.readouterr()
    summary = json.loads(output.out.splitlines()[-1])
    assert (summary["frames"], summary["width"], summary["height"]) == (TINY_FRAMES, *SIZE)
    assert 0 < summary["painted"] == summary["frames"] - summary["dropped"]
    assert set(summary["server_latency_ms"]) == set(summary["round_trip_ms"]) == {"p50", "p95", "p99"}
    assert summary["output"] == str(out) and "starting one" in output.err
    with av.open(str(out)) as file:
        assert len(file.streams.audio) == 1
        assert len(list(file.decode(video=0))) == summary["painted"]


def painted(url: str) -> float:
    """Number of frames that live sessions have painted."""
    lines = httpx.get(f"{url}/metrics", timeout=30).text.splitlines()
    return sum(
        float(line.split()[-1]) for line in lines if line.startswith('impasto_live_frames_total{outcome="painted"')
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_the_stream_in_order(
    tiny_clip: Path, tmp_path: Path, home: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    out = tmp_path / "out.mp4"
    only_echo(monkeypatch)
    with served(home) as (url, _):
        words = live("--input", tiny_clip, "--loop", "forever", "--output", out, "--server", url, "--method", "echo")
        child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            until(lambda: painted(url), 60)
            child.send_signal(number)
            output, _ = child.communicate(timeout=60)
        finally:
            child.kill()
    summary = json.loads(output.splitlines()[-1])
    assert child.returncode == 0, output
    assert summary["painted"] > 0
    assert [path.name for path in tmp_path.iterdir() if "out" in path.name] == ["out.mp4"]
    with VideoReader(out) as reader:
        assert reader.frames == summary["painted"]


@pytest.fixture
def url(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of a service with a capacity of one session and the method "echo"."""
    only_echo(monkeypatch)
    with served(home, live_sessions=1) as (address, _):
        yield address


def test_references_of_live_use_the_names_of_render(
    url: str, tiny_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    green = tmp_path / "green.png"
    green.write_bytes(encode_png(np.full((32, 32, 3), (10, 77, 10), np.uint8)))
    words = ["--input", str(tiny_clip), "--input", f"reference={green}", "--param", "add=5", "--codec", "raw"]
    frames = tmp_path / "frames"
    status = command(["live", *words, "--method", "echo", "--server", url, "--output", f"{frames}/", "--json"])
    output = capsys.readouterr()
    assert status == 0, output
    summary = json.loads(output.out.splitlines()[-1])
    assert (summary["output"], summary["codec"]) == (str(frames), "raw")
    painted = cv2.imread(str(frames / "0000.png"))
    assert painted[0, 0, 1:].tolist() == [77, 5]  # "echo" writes there what it was given
    assert len(list(frames.iterdir())) == summary["painted"]


def test_a_full_service_is_reported_and_keeps_existing_files(
    url: str, tiny_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.mp4"
    out.write_bytes(b"earlier")
    with LiveClient(url, size=SIZE, method="echo"):
        words = ["live", "--input", str(tiny_clip), "--output", str(out), "--method", "echo", "--server", url, "--json"]
        words.append("--overwrite")
        assert command(words) == 1
    error = json.loads(capsys.readouterr().out.splitlines()[-1])["error"]
    assert (error["code"], "Try again in 5 s" in error["remedy"]) == ("busy", True)
    assert out.read_bytes() == b"earlier"
