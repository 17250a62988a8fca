"""The renderer returns the frames of its method; analysis and painting may run in separate threads."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import pipeline.scenes
from pipeline.errors import BadFrame, BadInput, BadParameter
from pipeline.frames import Frame
from pipeline.methods.abstraction import Abstraction, AbstractionParams, AbstractionSession
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.steady import Steady, SteadyFilter, SteadyParams
from pipeline.quality.sharpness import edge_widths
from pipeline.video.stills import encode_png
from tests.workers.live_toys import Echo
from workers.blobs.disk import DiskBlobs
from workers.errors import NotFound
from workers.live.codecs import encoder
from workers.live.model import FilterOrder, FrameRequest, LiveOrder, Size, WireFormat
from workers.live.renderer import LiveRenderer

SIZE = (160, 96)
RAW = WireFormat("raw", "raw")


def scene(count: int, size: Size = SIZE) -> list[Frame]:
    made = pipeline.scenes.scene("portrait", size, frames=count)
    return [made.image(index) for index in range(count)]


def work(frame: Frame, work_size: Size = SIZE, key: bool = False) -> FrameRequest:
    return FrameRequest((frame.tobytes(),), (frame.shape[1], frame.shape[0]), work_size, key)


def order(method: str = "echo", **changes: object) -> LiveOrder:
    return replace(LiveOrder(method, {}, 0, {}, SIZE, RAW), **changes)  # type: ignore[arg-type]


@pytest.fixture
def blobs(home: Path) -> DiskBlobs:
    return DiskBlobs(home)


@pytest.fixture
def painter(blobs: DiskBlobs) -> Iterator[LiveRenderer]:
    made = LiveRenderer(blobs, lambda name: {"echo": Echo(), "abstraction": Abstraction(), "steady": Steady()}[name])
    yield made
    made.close()


def step(painter: LiveRenderer, one: FrameRequest) -> Frame:
    painter.analyze(one)
    painted = painter.paint()
    return np.frombuffer(painted.data, np.uint8).reshape(painted.size[1], painted.size[0], 3)


def test_a_stream_without_drops_has_the_bytes_of_the_batch_output(painter: LiveRenderer) -> None:
    frames = scene(16)
    painter.open(order("abstraction", params={"vividness": 1.3}))
    with ThreadPoolExecutor(1) as analyses, ThreadPoolExecutor(1) as paints:
        for frame in frames:
            analyses.submit(painter.analyze, work(frame))
        painted = [done.result().data for done in [paints.submit(painter.paint) for _ in frames]]
    session = AbstractionSession(AbstractionParams(vividness=1.3), SIZE)
    assert painted == [session.step(frame).tobytes() for frame in frames]


def test_live_references_give_the_output_of_a_job(painter: LiveRenderer, blobs: DiskBlobs) -> None:
    picture = scene(1, (64, 64))[0][..., ::-1].copy()
    blobs.put("assets/a", encode_png(picture))
    painter.open(order("abstraction", inputs={"reference": "assets/a"}))
    frames = scene(4)
    batch = Abstraction().stream(AbstractionParams(), SIZE, 0, {"reference": iter([picture])})
    assert all(np.array_equal(step(painter, work(frame)), batch.step(frame)) for frame in frames)


def test_a_live_histogram_gives_the_output_of_a_job_and_can_be_exchanged(
    painter: LiveRenderer, blobs: DiskBlobs
) -> None:
    rest = {"saturation_mean": 0.8, "saturation_std": 0.1, "value_mean": 0.6}
    for name, at in (("red", 0), ("yellow", 6)):
        hue = [float(index == at) for index in range(36)]
        blobs.put(f"assets/{name}", json.dumps({"hue": hue, **rest}).encode())
    blobs.put("assets/empty", json.dumps({"hue": [0] * 36, **rest}).encode())
    params, frames = {"hue_neighbourhood": 180, "lines": "off"}, scene(4)
    painter.open(order("abstraction", params=params, inputs={"histogram": "assets/red"}))
    context = LocalContext(AbstractionParams(**params), frames, {"histogram": {"hue": [1, *[0] * 35], **rest}})
    run_plan(Abstraction(), context)
    red = [step(painter, work(frame)) for frame in frames]
    np.testing.assert_array_equal(red, [context.emitted[index] for index in range(4)])
    with pytest.raises(BadInput) as raised:
        painter.change(order("abstraction", params=params, inputs={"histogram": "assets/empty"}))
    assert raised.value.field == "inputs.histogram.hue"
    painter.change(order("abstraction", params=params, inputs={"histogram": "assets/yellow"}))
    for _ in range(4):
        yellow = step(painter, work(frames[-1]))
    assert yellow[..., 1].mean() > red[-1][..., 1].mean() + 5


def test_a_size_change_keeps_the_state_of_the_method(painter: LiveRenderer) -> None:
    frame = scene(1)[0]
    painter.open(order())
    assert step(painter, work(frame)).shape == (96, 160, 3)
    smaller = step(painter, work(frame, (80, 48)))
    assert smaller.shape == (48, 80, 3)
    assert smaller[0, 0, 2] == 2
    expected = cv2.resize(frame, (80, 48), interpolation=cv2.INTER_AREA)
    assert np.array_equal(smaller[1:], expected[1:])


def test_abstraction_at_a_reduced_working_size_gives_frames_of_full_size(painter: LiveRenderer) -> None:
    frame = scene(1)[0]
    painter.open(order("abstraction"))
    for work_size in (SIZE, (80, 48), (40, 24), SIZE):
        assert step(painter, work(frame, work_size)).shape == (96, 160, 3)


def test_a_parameter_change_waits_for_analyzed_frames(painter: LiveRenderer) -> None:
    frame = scene(1)[0]
    painter.open(order(params={"add": 1}))
    with ThreadPoolExecutor(1) as analyses:
        analyses.submit(painter.analyze, work(frame))
        analyses.submit(painter.analyze, work(frame))
        changed = analyses.submit(painter.change, order(params={"add": 9}))
        assert painter.paint().data[0] == 1
        assert not changed.done()
        assert painter.paint().data[0] == 1
        changed.result(5)
    made = step(painter, work(frame))
    assert made[0, 0].tolist() == [9, 0, 3]


def test_references_are_added_and_removed_and_a_bad_one_is_ignored(painter: LiveRenderer, blobs: DiskBlobs) -> None:
    frame = scene(1)[0]
    blobs.put("assets/green", encode_png(np.full((32, 32, 3), (0, 77, 0), np.uint8)))
    blobs.put("assets/red", encode_png(np.full((32, 32, 3), (255, 0, 0), np.uint8)))
    blobs.put("assets/text", b"no picture at all")
    painter.open(order())
    painter.change(order(inputs={"reference": "assets/green"}))
    assert step(painter, work(frame))[0, 0, 1] == 77
    for bad, error in (("assets/red", BadInput), ("assets/text", BadInput), ("assets/gone", NotFound)):
        with pytest.raises(error) as raised:
            painter.change(order(params={"add": 5}, inputs={"reference": bad}))
        assert raised.value.field == "inputs.reference" or bad == "assets/red"
    assert step(painter, work(frame))[0, 0].tolist() == [0, 77, 2]
    painter.change(order())
    assert step(painter, work(frame))[0, 0, 1] == 0


STEADY = FilterOrder("steady", {"strength": 20})


def test_a_filter_gives_the_output_of_the_filter_over_the_painted_frames(painter: LiveRenderer) -> None:
    frames = scene(6)
    painter.open(order("abstraction", filter=STEADY))
    painter.analyze(work(frames[0]))
    painted = [painter.paint()]
    assert set(painted[0].stages_s) == {"decode", "analyze", "paint", "filter", "encode"}
    for frame in frames[1:]:
        painter.analyze(work(frame))
        painted.append(painter.paint())
    session, behind = AbstractionSession(AbstractionParams(), SIZE), SteadyFilter(SteadyParams(strength=20), SIZE)
    assert [each.data for each in painted] == [behind.step(f, session.step(f)).tobytes() for f in frames]


def test_a_filter_is_added_changed_and_removed_without_a_new_start(painter: LiveRenderer) -> None:
    frame, twin = scene(1)[0], AbstractionSession(AbstractionParams(), SIZE)
    painter.open(order("abstraction"))
    plain = step(painter, work(frame))
    assert np.array_equal(plain, twin.step(frame))
    painter.change(order("abstraction", filter=STEADY))
    for strength in (20, 5):
        painter.change(order("abstraction", filter=replace(STEADY, params={"strength": strength})))
        assert step(painter, work(frame)).shape == plain.shape
    with pytest.raises(BadParameter, match="not a live filter"):
        painter.change(order("abstraction", filter=FilterOrder("abstraction", {})))
    painter.change(order("abstraction"))
    painter.analyze(work(frame))
    assert "filter" not in painter.paint().stages_s


def test_filtered_frames_have_full_size_at_any_working_size(painter: LiveRenderer) -> None:
    frame = scene(1)[0]
    painter.open(order("abstraction", filter=STEADY))
    for work_size in (SIZE, (80, 48), (120, 72)):
        assert step(painter, work(frame, work_size)).shape == (96, 160, 3)


def test_edges_behind_a_filter_are_as_sharp_at_half_of_the_working_size(painter: LiveRenderer) -> None:
    painter.open(order("abstraction", filter=STEADY))
    widths = []
    for work_size in (SIZE, (80, 48)):
        frames = [step(painter, work(frame, work_size)) for frame in scene(4)]
        widths.append(float(np.median(edge_widths(frames[-1]))))
    assert widths[1] < widths[0] + 0.3


def test_paint_raises_analysis_errors_in_frame_order(painter: LiveRenderer) -> None:
    frame = scene(1)[0]
    painter.open(order())
    painter.analyze(work(frame))
    painter.analyze(FrameRequest((b"short",), SIZE, SIZE))
    assert painter.paint().data
    with pytest.raises(BadFrame):
        painter.paint()
    assert step(painter, work(frame))[0, 0, 2] == 2


def test_dropped_frames_are_decoded_before_the_next_frame(painter: LiveRenderer) -> None:
    frames = scene(4)
    wire = WireFormat("h264", "raw")
    there = encoder(WireFormat("raw", "h264"), SIZE)
    payloads = [there.encode(frame, False)[0] for frame in frames]
    painter.open(order(wire=wire))
    painter.analyze(FrameRequest(tuple(payloads), SIZE, SIZE))
    painted = painter.paint()
    made = np.frombuffer(painted.data, np.uint8).reshape(96, 160, 3)
    assert made[0, 0, 2] == 1, "one frame was painted"
    assert cv2.PSNR(made, frames[-1]) > 28


def test_a_reopened_renderer_uses_new_codecs(painter: LiveRenderer) -> None:
    frame = scene(1)[0]
    painter.open(order())
    step(painter, work(frame))
    painter.open(order(wire=WireFormat("raw", "jpeg"), params={"add": 3}))
    painter.analyze(work(frame))
    painted = painter.paint()
    assert painted.data.startswith(b"\xff\xd8")
    assert painted.stages_s.keys() == {"decode", "analyze", "paint", "encode"}
    painter.open(order(seed=1))
    assert step(painter, work(frame))[0, 0, 2] == 1, "another seed is another stream"


@pytest.mark.skipif(sys.platform != "linux", reason="threads have priorities of their own on Linux only")
def test_helpers_do_not_keep_the_low_priority_of_the_warm_up(blobs: DiskBlobs) -> None:
    """The helper runs in this process, which is pytest's."""
    usual, painter = os.getpriority(os.PRIO_PROCESS, 0), LiveRenderer(blobs, lambda name: Echo(), threads=2)  # type: ignore[arg-type, return-value]
    busy = np.zeros((1000, 1000), np.uint8)

    def warm_up() -> list[int]:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), usual + 5)
        painter.warm_up()
        cv2.GaussianBlur(busy, (9, 9), 2)
        return priorities()

    def priorities() -> list[int]:
        found = []
        for thread in Path("/proc/self/task").iterdir():
            with contextlib.suppress(ProcessLookupError):  # it ended meanwhile
                found.append(os.getpriority(os.PRIO_PROCESS, int(thread.name)))
        return found

    with ThreadPoolExecutor(1) as background:
        assert background.submit(warm_up).result().count(usual + 5) >= 2, (
            "OpenCV's helper has it too, or this tests nothing"
        )
    painter.open(order())
    cv2.GaussianBlur(busy, (9, 9), 2)
    deadline = time.monotonic() + 30
    try:
        while usual + 5 in priorities():  # the thread of the warm-up is listed for a moment after it was joined
            assert time.monotonic() < deadline, "a thread has the warm-up's priority"
            time.sleep(0.01)
    finally:
        cv2.setNumThreads(1)


def test_bad_parameters_and_missing_references_are_refused_on_opening(painter: LiveRenderer) -> None:
    with pytest.raises(BadParameter, match="greater"):
        painter.open(order(params={"add": -1}))
    with pytest.raises(NotFound):
        painter.open(order(inputs={"reference": "assets/gone"}))
