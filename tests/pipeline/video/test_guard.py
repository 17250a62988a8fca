"""Decoding of hostile files in child processes: equal results, limits, and replacement of failed processes."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadFrame, Cancelled, MediaTooLarge, UnreadableMedia
from pipeline.formats.decoding import decode_planes, decode_raw
from pipeline.formats.exr import write_exr
from pipeline.perception.cuts import thumbnail
from pipeline.video.guard import decoder_process, roles
from pipeline.video.guard.decoder_process import DecoderProcess
from pipeline.video.guard.decoder_server import SERVER
from pipeline.video.guard.files import GuardedImages, guarded_join
from pipeline.video.guard.pictures import _DECODER, guarded_planes, guarded_raw
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.guard.wire import ConnectionBroken, receive, send
from pipeline.video.join import join
from pipeline.video.media import Limits
from pipeline.video.numbered import NumberedImages
from pipeline.video.probe import probe_guarded
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer
from tests.pipeline.video.making import make_video, make_zip, picture, png_frames

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return make_video(tmp_path / "a.mp4", [picture(i) for i in range(12)])


def pid_of(guarded: GuardedReader | GuardedImages) -> int:
    """Process id of the decoder process."""
    return guarded._child._pid


def kill(guarded: GuardedReader | GuardedImages) -> None:
    """Kill the decoder process, unless it is gone and its replacement has not begun."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid_of(guarded), signal.SIGKILL)


def same(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> bool:
    return a.dtype == b.dtype and np.array_equal(a, b)


def test_a_guarded_reader_reads_the_same_frames(clip: Path, tmp_path: Path) -> None:
    for path in (clip, make_zip(tmp_path / "a.zip", png_frames(5))):
        with VideoReader(path) as plain, GuardedReader(path) as guarded:
            for name in ("size", "rotation_deg", "pixel_format", "frames", "time_base", "fps", "position"):
                assert getattr(plain, name) == getattr(guarded, name), name
            assert np.array_equal(plain.timestamps, guarded.timestamps)
            assert np.array_equal(plain.index.keys, guarded.index.keys) and plain.index.end == guarded.index.end
            for span in ((0, None), (3, 5), (4, 4), (1, 400)):
                pairs = list(zip(plain.read(*span), guarded.read(*span), strict=True))
                assert all(same(a, b) for a, b in pairs)
                assert plain.position == guarded.position


def test_thumbnails_are_those_of_the_frames(clip: Path, tmp_path: Path) -> None:
    for path in (clip, make_zip(tmp_path / "a.zip", png_frames(40))):
        with VideoReader(path) as plain, GuardedReader(path) as guarded:
            for span in ((0, None), (3, 5), (4, 4), (1, 400)):
                expected = [thumbnail(frame) for frame in plain.read(*span)]
                assert np.array_equal(expected, list(guarded.read_thumbnails(*span)))
                assert plain.position == guarded.position


def test_damage_is_reported_with_thumbnails_as_with_frames(tmp_path: Path) -> None:
    path = make_video(tmp_path / "a.mp4", [picture(i) for i in range(40)])
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 400] = bytes(400)
    path.write_bytes(data)
    with GuardedReader(path) as frames, GuardedReader(path) as thumbnails:
        assert len(list(frames.read())) == len(list(thumbnails.read_thumbnails()))
        assert frames.unreadable == thumbnails.unreadable and frames.unreadable
        assert frames.errors == thumbnails.errors


def test_frames_are_copies(clip: Path) -> None:
    with GuardedReader(clip) as reader:
        first, second = reader.read(0, 2)
        kept = first.copy()
        list(reader.read(5, 9))
        assert same(first, kept) and not same(first, second)
        first[...] = 0


def test_an_abandoned_read_does_not_affect_the_next(clip: Path) -> None:
    with GuardedReader(clip) as reader, VideoReader(clip) as plain:
        walk = reader.read(0, 10)
        next(walk)
        walk.close()
        assert same(next(reader.read(7, 8)), next(plain.read(7, 8)))
        with pytest.raises(ValueError, match="no frames"):
            reader.read(5, 4)


def test_errors_of_a_file_are_those_of_the_plain_reader(tmp_path: Path) -> None:
    bad = tmp_path / "a.mp4"
    bad.write_bytes(b"\0\0\0\x18ftypmp42" + b"rubbish" * 100)
    with pytest.raises(UnreadableMedia) as guarded:
        GuardedReader(bad)
    with pytest.raises(UnreadableMedia) as plain:
        VideoReader(bad)
    assert str(guarded.value) == str(plain.value)
    with pytest.raises(FileNotFoundError):
        GuardedReader(tmp_path / "none.mp4")
    with pytest.raises(MediaTooLarge):
        GuardedReader(make_video(tmp_path / "b.mp4", [picture(0)]), Limits(side_px=32))
    frames = png_frames(3)
    frames["frame_2.png"] = cv2.imencode(".png", np.zeros((40, 40, 3), np.uint8))[1].tobytes()
    with GuardedReader(make_zip(tmp_path / "c.zip", frames)) as reader, pytest.raises(BadFrame):
        list(reader.read())


def test_numbered_images(tmp_path: Path) -> None:
    masks = {
        f"m_{n:03}.png": cv2.imencode(".png", np.full((20, 17), 1000 * n, np.uint16))[1].tobytes() for n in (2, 10)
    }
    path = make_zip(tmp_path / "a.zip", masks)
    plain, guarded = NumberedImages(path, "inputs.masks"), GuardedImages(path, "inputs.masks")
    assert list(guarded) == list(plain) == [2, 10] and len(guarded) == 2
    assert all(np.array_equal(guarded[n], plain[n]) and guarded[n].dtype == np.uint16 for n in plain)
    with pytest.raises(KeyError):
        guarded[3]
    plain.close()
    guarded.close()


def test_joining(tiny_clip: Path, tmp_path: Path) -> None:
    plain, guarded = tmp_path / "plain.mp4", tmp_path / "guarded.mp4"
    segment = tmp_path / "segment"
    with segment_writer(segment, SegmentSpec("mp4", (96, 64), Fraction(1, 24), 24.0)) as writer:
        for index in range(3):
            writer.write(index, picture(index), index, index + 1)
    reported: list[float] = []
    join([(Fraction(0), segment)], plain, "mp4", tiny_clip)
    guarded_join([(Fraction(0), segment)], guarded, "mp4", tiny_clip, reported.append)
    assert plain.read_bytes() == guarded.read_bytes()
    assert reported == [1.0]

    def stop(done: float) -> None:
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        guarded_join([(Fraction(0), segment)], tmp_path / "c.mp4", "mp4", tiny_clip, stop)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSEGV])
def test_a_decoder_that_dies_raises_an_error(clip: Path, how: signal.Signals, monkeypatch: pytest.MonkeyPatch) -> None:
    with GuardedReader(clip) as reader:
        frames = reader.read()
        next(frames)
        began = reader._begin

        def begin_and_die() -> DecoderProcess:
            child = began()
            os.kill(child._pid, how)
            return child

        monkeypatch.setattr(reader, "_begin", begin_and_die)
        os.kill(pid_of(reader), how)
        with pytest.raises(UnreadableMedia, match="crashes"):
            list(frames)
    with GuardedReader(clip) as reader:
        assert len(list(reader.read())) == 12


def test_a_killed_decoder_is_replaced(clip: Path, tmp_path: Path) -> None:
    with VideoReader(clip) as plain, GuardedReader(clip) as reader:
        for index, (frame, other) in enumerate(zip(plain.read(2), reader.read(2), strict=True)):
            assert same(frame, other)
            if index in (0, 4):
                kill(reader)
        expected = [thumbnail(frame) for frame in plain.read()]
        for index, (one, other) in enumerate(zip(expected, reader.read_thumbnails(), strict=True)):
            assert np.array_equal(one, other)
            if index in (0, 4):
                kill(reader)
    path = make_zip(tmp_path / "a.zip", png_frames(3))
    images = GuardedImages(path, "inputs.masks")
    kill(images)
    assert images[2].shape == (64, 96, 3)
    images.close()


def test_a_decoder_that_hangs_is_killed(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with GuardedReader(clip) as reader:
        child = psutil.Process(pid_of(reader))
        child.suspend()
        reader._child._wire.settimeout(0.2)
        with pytest.raises(UnreadableMedia, match="too long"):
            list(reader.read())
        assert gone(child)


def gone(process: psutil.Process, timeout_s: float = 5.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if not process.is_running() or process.status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False


def test_a_child_has_few_resources_and_permissions(clip: Path) -> None:
    with GuardedReader(clip) as reader:
        child = psutil.Process(pid_of(reader))
        assert child.rlimit(psutil.RLIMIT_FSIZE) == (0, 0) and child.rlimit(psutil.RLIMIT_CORE) == (0, 0)
        assert child.rlimit(psutil.RLIMIT_AS)[0] < child.memory_info().vms + (5 << 30)
        assert "NoNewPrivs:\t1" in Path(f"/proc/{child.pid}/status").read_text()
        others = [fd for fd in Path(f"/proc/{child.pid}/fd").iterdir() if int(fd.name) > 2]
        assert len(others) <= 5, (
            "its file, its connection, its shared memory, its reserved file in memory: nothing else"
        )


def test_a_child_cannot_allocate_too_much_memory(clip: Path, tmp_path: Path) -> None:
    """A frame of 12 MB does not fit into 1 MiB; a small one may fit into what the process has allocated before."""
    large = make_video(tmp_path / "large.mp4", [cv2.resize(picture(0), (2048, 2048))])
    with pytest.raises(UnreadableMedia):
        DecoderProcess("probe", {"path": str(large), "limits": {}}, 1, memory_bytes=1 << 20)
    assert probe_guarded(large).frames == 1
    assert probe_guarded(clip).frames == 12


def test_a_closed_reader_leaves_no_process(clip: Path) -> None:
    reader = GuardedReader(clip)
    child = psutil.Process(pid_of(reader))
    reader.close()
    reader.close()
    assert gone(child)


def test_a_decoder_server_that_died_is_started_again(clip: Path) -> None:
    GuardedReader(clip).close()
    (server,) = [p for p in psutil.Process().children() if "pipeline.video.guard.server_main" in " ".join(p.cmdline())]
    with GuardedReader(clip) as reader:
        child = psutil.Process(pid_of(reader))
        server.kill()
        server.wait(5)
        assert gone(child), "children do not outlive it"
    with GuardedReader(clip) as reader:
        assert len(list(reader.read())) == 12


def test_a_decoder_server_that_dies_during_a_request_is_replaced(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes the request and dies before it has forked."""
    GuardedReader(clip).close()
    (server,) = [p for p in psutil.Process().children() if "pipeline.video.guard.server_main" in " ".join(p.cmdline())]
    server.suspend()
    asked, stuck = SERVER.fork, [server]

    def ask_and_kill(*fds: int) -> None:
        asked(*fds)
        if stuck:
            stuck.pop().kill()

    monkeypatch.setattr(SERVER, "fork", ask_and_kill)
    with GuardedReader(clip) as reader:
        assert len(list(reader.read())) == 12


def test_a_decoder_server_that_hangs_is_replaced(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    GuardedReader(clip).close()
    (server,) = [p for p in psutil.Process().children() if "pipeline.video.guard.server_main" in " ".join(p.cmdline())]
    server.suspend()
    usual_s, stop = decoder_process.START_S, SERVER.stop

    def stop_and_wait_as_usual() -> None:
        monkeypatch.setattr(decoder_process, "START_S", usual_s)
        stop()

    monkeypatch.setattr(decoder_process, "START_S", 1.0)
    monkeypatch.setattr(SERVER, "stop", stop_and_wait_as_usual)
    with GuardedReader(clip) as reader:
        assert len(list(reader.read())) == 12
    assert not server.is_running()


def test_child_processes_end_with_the_parent(clip: Path) -> None:
    code = f"""
import os, sys
from pathlib import Path
from pipeline.video.guard.reader import GuardedReader
reader = GuardedReader(Path({str(clip)!r}))
print(reader._child._pid, flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", code]
    parent = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert parent.stdout
    child = psutil.Process(int(parent.stdout.readline()))
    server = child.parent()
    assert server is not None
    parent.kill()
    parent.wait()
    assert gone(child) and gone(server)


_KEPT_OPEN: list[socket.socket] = []


def answering(*replies: Callable[[socket.socket], None]) -> DecoderProcess:
    """Our side of a connection to a compromised child, which sends these messages."""
    child = DecoderProcess.__new__(DecoderProcess)
    child._wire, theirs = socket.socketpair()
    child._wire.settimeout(5)
    child._timeout_s, child._pid = 5.0, 0
    import mmap

    child._memory = mmap.mmap(-1, 64)
    for reply in replies:
        reply(theirs)
    _KEPT_OPEN.append(theirs)
    return child


def test_a_compromised_child_cannot_affect_the_parent() -> None:
    """It can return wrong pictures, but cannot make us run, open or allocate anything."""
    with pytest.raises(UnreadableMedia):
        answering(lambda wire: wire.sendall(struct.pack("!II", 1 << 31, 0))).ask({})
    with pytest.raises(UnreadableMedia):
        answering(lambda wire: wire.sendall(struct.pack("!II", 4, 0) + b"\x80\x04K.")).ask({})
    with pytest.raises(UnreadableMedia):
        answering(lambda wire: send(wire, {})).array((1 << 20, 1 << 20), "u1")
    with pytest.raises(UnreadableMedia):
        answering(lambda wire: send(wire, {})).array((2,), "O")
    lies = {"error": {"kind": "SystemExit", "message": "x"}}
    with pytest.raises(Exception, match="x") as caught:
        answering(lambda wire: send(wire, lies)).ask({})
    assert not isinstance(caught.value, SystemExit)


def test_messages_are_checked() -> None:
    ours, theirs = socket.socketpair()
    theirs.sendall(struct.pack("!II", 2, 0) + b"[]")
    with pytest.raises(ConnectionBroken, match="no object"):
        receive(ours)
    send(theirs, {"a": 1}, b"xyz")
    assert receive(ours) == ({"a": 1}, b"xyz")
    theirs.close()
    with pytest.raises(ConnectionBroken, match="closed"):
        receive(ours)


def test_every_role_is_used() -> None:
    """A decoder role that nothing uses would be an attack surface without tests."""
    asked = "".join(path.read_text() for path in (ROOT / "pipeline" / "video").rglob("*.py"))
    assert [role for role in roles.ROLES if f'("{role}", ' not in asked] == []


# -- pictures of a shot


def test_guarded_pictures_equal_those_decoded_in_process(tmp_path: Path) -> None:
    gray = np.arange(40 * 30, dtype=np.uint16).reshape(30, 40) * 40
    data = cv2.imencode(".png", gray)[1].tobytes()
    assert same(guarded_raw(data, "a.png"), decode_raw(data, Limits(), "a.png"))
    planes = {f"ViewLayer.Combined.{name}": np.full((20, 24), i / 4, np.float32) for i, name in enumerate("RGB")}
    write_exr(tmp_path / "a.exr", planes)
    data = (tmp_path / "a.exr").read_bytes()
    image, plain = guarded_planes(data, "a.exr"), decode_planes(data, Limits(), "a.exr")
    assert image.size == plain.size == (24, 20) and list(image.planes) == list(plain.planes)
    assert all(np.array_equal(image.planes[name], plain.planes[name]) for name in planes)


def test_an_invalid_picture_does_not_affect_the_next() -> None:
    data = cv2.imencode(".png", np.zeros((32, 32), np.uint8))[1].tobytes()
    guarded_raw(data, "good.png")
    pid = _DECODER.child._pid if _DECODER.child else 0
    with pytest.raises(UnreadableMedia) as caught:
        guarded_raw(data[: len(data) // 2], "masks/0007.png")
    assert "masks/0007.png" in f"{caught.value.field} {caught.value.value} {caught.value.message}"
    assert guarded_raw(data, "good.png").shape == (32, 32)
    assert _DECODER.child and _DECODER.child._pid == pid, "it was not at fault"


def test_a_killed_picture_decoder_is_replaced() -> None:
    data = cv2.imencode(".png", np.zeros((32, 32), np.uint8))[1].tobytes()
    guarded_raw(data, "good.png")
    assert _DECODER.child
    os.kill(_DECODER.child._pid, signal.SIGKILL)
    assert guarded_raw(data, "good.png").shape == (32, 32)
