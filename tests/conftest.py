"""Fixtures of all tests: real services that are present or reported missing, one small clip, an empty home."""

from __future__ import annotations

import faulthandler
import gc
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import av
import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from numpy.typing import NDArray
from pydantic_settings import BaseSettings, SettingsConfigDict

from service import bundle
from tests.parallel import Scheduling, arrange, how_it_ended

if TYPE_CHECKING:  # they are imported where they are needed: most tests have no server
    from tests.real.postgres import Postgres
    from tests.real.swift import Swift

ROOT = Path(__file__).resolve().parent.parent
gc.disable()  # until all tests are imported (pytest_collection_finish): a fifth of that time is a search for garbage
# Services that tests start load the kernels that a test uses; to load all of them takes three seconds a process.
os.environ.setdefault("IMPASTO_WARM_UP", "false")
os.environ.setdefault("IMPASTO_LIVE_SPARES", "0")
os.environ.setdefault("RAY_worker_niceness", "0")  # as in the images; else actors starve beside other programs
MEDIA = ROOT.parent / "shared" / "media"
settings.register_profile("impasto", deadline=None, suppress_health_check=[HealthCheck.too_slow])  # no time limits
settings.load_profile("impasto")


class TestSettings(BaseSettings):
    """Settings of a test run, from the environment.

    IMPASTO_REQUIRE_REAL=1 makes a missing real part a failure: CI proves that nothing was skipped.
    IMPASTO_ENCODER_RUNS: how often each encoder is repeated to see whether its bytes vary (0: the default of the test).
    """

    __test__ = False
    model_config = SettingsConfigDict(env_prefix="IMPASTO_")
    require_real: bool = False
    encoder_runs: int = 0


def _missing_chromium() -> str:
    return "" if shutil.which("chromium") else "there is no chromium on the PATH: apt-get install chromium"


def _missing_opencl() -> str:
    from pipeline.compute import report

    rows = report(fresh=False)
    return "" if any(row["chosen"] for row in rows) else f"OpenCL: {rows[0]['reason']}"


def _missing_media() -> str:
    return "" if MEDIA.is_dir() else f"there is no media folder at {MEDIA}"


def _missing_ray() -> str:
    return "" if importlib.util.find_spec("ray") else "ray is not installed: pip install 'ray[default]'"


def _missing_postgres() -> str:
    from tests.real.postgres import missing

    return missing()


def _missing_s3() -> str:
    from tests.real.swift import missing

    return missing()


def _missing_prometheus() -> str:
    from tests.real.prometheus import missing

    return missing()


def _missing_compose() -> str:
    return "" if shutil.which("docker-compose") else "there is no docker-compose: apt-get install docker-compose"


def _missing_nginx() -> str:
    from tests.real.nginx import missing

    return missing()


def _missing_systemd() -> str:
    return "" if shutil.which("systemd-analyze") else "there is no systemd-analyze: apt-get install systemd"


def _missing_webrtc() -> str:
    return "" if importlib.util.find_spec("aiortc") else "aiortc is not installed: pip install 'impasto[webrtc]'"


def _missing_registry() -> str:
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", tempfile.mkdtemp(), "h11"]
    try:
        reached = subprocess.run(command, capture_output=True, timeout=60).returncode == 0
    except subprocess.TimeoutExpired:
        reached = False
    return "" if reached else "pip reaches no package registry"


PARTS: dict[str, Callable[[], str]] = {
    "chromium": _missing_chromium,
    "opencl": _missing_opencl,
    "media": _missing_media,
    "ray": _missing_ray,
    "postgres": _missing_postgres,
    "s3": _missing_s3,
    "prometheus": _missing_prometheus,
    "systemd": _missing_systemd,
    "nginx": _missing_nginx,
    "compose": _missing_compose,
    "registry": _missing_registry,
    "webrtc": _missing_webrtc,
}
MAY_BE_ABSENT = {"media", "registry"}
"""Test media are not ours to ship, and a build must not depend on a server: they may be absent even where every part
must be real."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Arrange tests for several processes. Alone, the order stays that of the files."""
    if config.getoption("numprocesses", None) or hasattr(config, "workerinput"):
        arrange(items)


def pytest_collection_finish() -> None:
    """Start garbage collection now, and exclude the imported objects from it."""
    gc.freeze()
    gc.enable()


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Scheduling:
    return Scheduling(config, log)


def pytest_testnodedown(node: Any, error: object) -> None:
    """Say how a test process ended before its time: xdist names the test in which it did, but not the reason."""
    if error is not None:
        node.config.get_terminal_writer().line(f"\n{node.gateway.id}: {how_it_ended(node.gateway._io.popen)}")


HANGING_S = 420
"""How long a phase of a test may last. pytest-timeout fails a test after 300 s; this limit is for what its exception
cannot end: a fixture that waits in its end for what has hung, a call into a library. The process prints its stacks and
ends, its test fails, and another process goes on."""


@pytest.hookimpl(wrapper=True)
def _ended_if_it_hangs() -> Iterator[None]:
    assert sys.__stderr__ is not None
    faulthandler.dump_traceback_later(HANGING_S, exit=True, file=sys.__stderr__)
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()


pytest_runtest_call = pytest_runtest_teardown = _ended_if_it_hangs


def pytest_runtest_setup(item: pytest.Item) -> None:
    for mark in item.iter_markers("real"):
        for part in mark.args:
            _require(str(part))


def _require(part: str) -> None:
    if part not in PARTS:
        pytest.fail(f"unknown real part {part!r}: one of {', '.join(PARTS)}")
    if not (reason := PARTS[part]()):
        return
    if TestSettings().require_real and part not in MAY_BE_ABSENT:
        pytest.fail(f"{part} is required (IMPASTO_REQUIRE_REAL=1): {reason}")
    pytest.skip(f"{part}: {reason}")


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """One PostgreSQL for the whole session. A test that stops it starts it again."""
    _require("postgres")
    from tests.real.postgres import Postgres

    server = Postgres()
    server.start()
    yield server
    server.close()


@pytest.fixture(scope="session")
def s3() -> Iterator[Swift]:
    """One S3 server for the whole session. A test that stops it starts it again."""
    _require("s3")
    from tests.real.swift import Swift

    server = Swift()
    server.start()
    yield server
    server.close()


@pytest.fixture(scope="session", autouse=True)
def one_opencv_thread() -> Iterator[None]:
    """One OpenCV thread: its thread pool disturbs timings and determinism checks when many tests share two cores."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


@pytest.fixture(scope="session")
def pages() -> Path:
    """The built pages of this checkout; they are built now if a source has changed."""
    bundle.build()
    return bundle.DIST


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """An empty home for a farm: its database and blobs go here."""
    return tmp_path / "home"


@pytest.fixture(scope="session")
def media() -> Path:
    """The folder of real clips; use with `@pytest.mark.real("media")`."""
    return MEDIA


TINY_FRAMES, TINY_WIDTH, TINY_HEIGHT, TINY_FPS = 24, 96, 64, 12


def tiny_frame(index: int) -> NDArray[np.uint8]:
    """Frame `index` of the tiny clip: a disc that moves right, a bar that moves down, over a colour ramp."""
    frame = np.empty((TINY_HEIGHT, TINY_WIDTH, 3), np.uint8)
    frame[..., 0] = np.linspace(40, 120, TINY_WIDTH, dtype=np.uint8)
    frame[..., 1] = np.linspace(90, 160, TINY_HEIGHT, dtype=np.uint8)[:, None]
    frame[..., 2] = 110
    cv2.rectangle(frame, (70, 4 + index), (86, 14 + index), (30, 60, 200), -1)
    cv2.circle(frame, (16 + 2 * index, 40), 12, (220, 180, 40), -1)
    return frame


@pytest.fixture(scope="session")
def tiny_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A two second H.264/AAC MP4 of 24 frames, 96x64 px, 12 fps, with a tone. Do not change it: it is shared."""
    path = tmp_path_factory.mktemp("media") / "tiny.mp4"
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", rate=TINY_FPS, options={"crf": "12"})
        video.width, video.height, video.pix_fmt = TINY_WIDTH, TINY_HEIGHT, "yuv420p"
        audio = out.add_stream("aac", rate=44100, layout="mono")
        for index in range(TINY_FRAMES):
            out.mux(video.encode(av.VideoFrame.from_ndarray(tiny_frame(index), format="rgb24")))
        out.mux(video.encode(None))
        for packet in _tone(audio):
            out.mux(packet)
    return path


def _tone(stream: av.AudioStream) -> Iterator[list[av.Packet]]:
    """Two seconds of a 440 Hz tone in frames of the encoder's size."""
    seconds, rate = TINY_FRAMES / TINY_FPS, 44100
    samples = (np.sin(np.arange(int(seconds * rate)) * 2 * np.pi * 440 / rate) * 8000).astype(np.int16)
    for start in range(0, len(samples), 1024):
        frame = av.AudioFrame.from_ndarray(samples[None, start : start + 1024], format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = rate, start, Fraction(1, rate)
        yield stream.encode(frame)
    yield stream.encode(None)
