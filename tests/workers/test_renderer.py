"""The renderer turns a task order into an outcome: with a toy method, on real blobs."""

from __future__ import annotations

import io
import json
import logging
import re
import shutil
import threading
import time
import zipfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from pipeline.errors import BadMedia
from pipeline.methods.base import Method, Params, PlanContext, Step, Task, TaskContext, TaskResult
from pipeline.quality import sampling
from pipeline.video.media import MediaInfo
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.stills import encode_png
from tests.conftest import TINY_FRAMES
from tests.e2e.pages import CHROMIUM_ARGS, SHELL
from workers.blobs.disk import DiskBlobs
from workers.contract.order import CPU, PEAK_MEMORY, TaskOrder, TaskOutcome
from workers.contract.request import OutputSpec
from workers.execution.artefact_handover import ArtefactHandover
from workers.execution.decoders import Decoders
from workers.execution.renderer import Renderer, Shared

RUN = 10
LOG = logging.getLogger("pipeline.methods.toy")


class ToyParams(Params):
    fault: str = ""


def plan(context: PlanContext) -> list[Task]:
    edges = [*range(0, context.video.frames, RUN), context.video.frames]
    return [
        Task(f"run-{start}", {"start": start, "stop": stop}, (f"run-{start - RUN}",) if start else (), (start, stop))
        for start, stop in pairwise(edges)
    ]


def invert(task: Task, context: TaskContext) -> TaskResult:
    """Invert each frame, counting on from the state that the previous task saved."""
    start, stop = task.args["start"], task.args["stop"]
    LOG.info("inverting from %d", start)
    count = int(context.load("invert", task.after[0])["count"]) if task.after else 0
    for index, frame in enumerate(context.frames("video", start, stop), start=start):
        with context.clock("invert"):
            painted = 255 - frame
        FAULTS.get(context.params.fault, _no_fault)(context, index, painted)
        count += 1
        context.progress(count / context.video.frames)
    context.save(task.key, {"count": np.int64(count), "labels": np.zeros((64, 96), np.int32)})
    context.save_file(f"svg-{task.key}.svg", b"<svg/>", "image/svg+xml")
    context.save_file("colours.json", b"{}", "application/json")
    return {"count": count}


def _helped(context: TaskContext, index: int, painted: Any) -> None:
    def help_out() -> None:
        with context.clock("help"):
            LOG.info("helping with %d", index)

    unrelated = threading.Thread(target=LOG.info, args=("not of this task",))
    unrelated.start()
    unrelated.join()
    with ThreadPoolExecutor(1) as helper:
        helper.submit(help_out).result()
    context.emit(index, painted)


def _no_fault(context: TaskContext, index: int, painted: Any) -> None:
    context.emit(index, painted)


def _twice(context: TaskContext, index: int, painted: Any) -> None:
    context.emit(index, painted)
    context.emit(index, painted)


def _skip(context: TaskContext, index: int, painted: Any) -> None:
    if index != 4:
        context.emit(index, painted)


def _drop_last(context: TaskContext, index: int, painted: Any) -> None:
    if index % RUN != RUN - 1:
        context.emit(index, painted)


def _small(context: TaskContext, index: int, painted: Any) -> None:
    context.emit(index, painted[:32])


def _raise(context: TaskContext, index: int, painted: Any) -> None:
    raise RuntimeError("the brush broke")


def _unwilling(context: TaskContext, index: int, painted: Any) -> None:
    raise BadMedia("There is no cat in it.", field="inputs.video", remedy="Add a cat.")


def _hang(context: TaskContext, index: int, painted: Any) -> None:
    while True:
        context.progress(0.5)
        time.sleep(0.01)


FAULTS = {
    "helped": _helped,
    "twice": _twice,
    "skip": _skip,
    "drop-last": _drop_last,
    "small": _small,
    "raise": _raise,
    "unwilling": _unwilling,
    "hang": _hang,
}


class Toy(Method):
    name = "toy"
    title = summary = paper = ""
    Params = ToyParams
    inputs = ()
    steps = (Step("invert", "Invert", plan, invert),)
    artefacts = ("svg",)
    examples = ()

    def stream(self, params: Any, size: tuple[int, int], seed: int, references: Any) -> None:
        return None


@pytest.fixture
def blobs(home: Path, tiny_clip: Path) -> DiskBlobs:
    made = DiskBlobs(home)
    made.put("assets/video", tiny_clip)
    return made


@pytest.fixture
def renderer(blobs: DiskBlobs, tmp_path: Path) -> Iterator[Renderer]:
    with Renderer(blobs, tmp_path / "scratch", lambda name: Toy()) as made:
        yield made
    assert list((tmp_path / "scratch").iterdir()) == [], "scratch files are left"


@pytest.fixture(scope="session")
def info(tiny_clip: Path) -> MediaInfo:
    return probe(tiny_clip)


def order_of(info: MediaInfo, task: Task, artefacts: dict[str, str] | None = None, **changes: Any) -> TaskOrder:
    order = TaskOrder(
        attempt_id=f"att_{task.key}",
        job_id="job_1",
        task_id=f"tsk_{task.key}",
        step="invert",
        method="toy",
        key=task.key,
        args=task.args,
        emits=task.emits,
        after=task.after,
        params={},
        seed=0,
        inputs={"video": "assets/video"},
        input_info={"video": info.as_json()},
        output=OutputSpec("mp4", 12, ("svg",)),
        results={},
        artefacts=artefacts or {},
    )
    return replace(order, **changes)


def tasks_of(info: MediaInfo) -> list[Task]:
    video = {"width": info.width, "height": info.height, "frames": info.frames}
    return plan(PlanContext(ToyParams(), 0, type("Video", (), video)()))


def render(renderer: Renderer, info: MediaInfo, **changes: Any) -> tuple[list[TaskOutcome], TaskOrder]:
    """Run every task; the outcomes, and the order of the last step."""
    outcomes: list[TaskOutcome] = []
    artefacts: dict[str, str] = {}
    segments = []
    for task in tasks_of(info):
        outcomes.append(renderer.run(order_of(info, task, artefacts, **changes)))
        assert outcomes[-1].fault is None, outcomes[-1]
        artefacts |= outcomes[-1].artefacts
        assert task.emits and outcomes[-1].segment
        segments.append((*task.emits, outcomes[-1].segment))
    last = order_of(info, Task("assemble"), artefacts, step="assemble", segments=tuple(segments), **changes)
    last = replace(last, stages={"invert": {"decode": 0.5}})
    return outcomes, last


def test_a_job_without_overview_has_no_previews_poster_and_contact_sheet(info: MediaInfo, blobs: DiskBlobs) -> None:
    with Renderer(blobs, None, lambda name: Toy(), overview=False) as renderer:
        outcomes, last = render(renderer, info)
        assert {name for outcome in outcomes for name in outcome.files} == {"colours.json"}
        assert set(renderer.run(last).files) == {"result", "report", "svg"}


def test_renderers_of_a_process_pass_artefacts_on_in_memory(info: MediaInfo, blobs: DiskBlobs) -> None:
    first, second, *_ = tasks_of(info)
    shared = Shared(Decoders(blobs), ArtefactHandover())
    with Renderer(blobs, None, lambda name: Toy(), shared=shared) as one:
        made = one.run(order_of(info, first)).artefacts
    assert made["invert/run-0"] == "jobs/job_1/invert/run-0/att_run-0/run-0.npz"
    blobs.put(made["invert/run-0"], b"damaged")
    with Renderer(blobs, None, lambda name: Toy(), shared=shared) as other:
        assert other.run(order_of(info, second, made)).result == {"count": 20}
        again = other.run(order_of(info, second, made))
        assert again.fault is not None, "each artefact is passed on once, to the task that it was made for"
    shared.decoders.close()


def test_a_job_from_frames_to_file(renderer: Renderer, info: MediaInfo, blobs: DiskBlobs, tiny_clip: Path) -> None:
    outcomes, last = render(renderer, info)
    assert [o.result["count"] for o in outcomes] == [10, 20, 24]
    done = renderer.run(last)
    assert done.fault is None, done
    assert set(done.files) == {"result", "poster", "sheet", "report", "svg"}
    assert (done.result["frames"], done.result["width"], done.result["height"]) == (TINY_FRAMES, 96, 64)
    with blobs.local(done.files["result"][0]) as path, VideoReader(path) as got, VideoReader(tiny_clip) as given:
        pairs = zip(given.read(), got.read(), strict=True)
        assert max(abs(255 - a.astype(int) - b).mean() for a, b in pairs) < 5
        with av.open(str(path)) as container:
            assert container.streams.audio
    with zipfile.ZipFile(io.BytesIO(blobs.get(done.files["svg"][0]))) as archive:
        assert archive.namelist() == ["svg-run-0.svg", "svg-run-10.svg", "svg-run-20.svg"]
    report = json.loads(blobs.get(done.files["report"][0]))
    assert (report["result"], report["seconds"]) == (done.result, {"invert": {"decode": 0.5}})


def test_a_job_gets_a_quality_report_on_request(renderer: Renderer, info: MediaInfo, blobs: DiskBlobs) -> None:
    _, last = render(renderer, info, output=OutputSpec("mp4", 12, ("svg",), report=True))
    done = renderer.run(last)
    assert done.fault is None, done
    quality = json.loads(blobs.get(done.files["report"][0]))["quality"]
    assert quality["pairs"] == 1 and 0 < quality["flicker"] < 3 and quality["structure"] > 0.5
    summary = done.result["quality"]
    assert summary == {name: value for name, value in quality.items() if name not in ("samples", "worst")}
    again = renderer.run(last)
    assert again.result == done.result


class Scanning(Toy):
    """A toy method whose first step reads the whole video, slowly enough for several pairs of frames."""

    steps = (Step("scan", "Scan", lambda context: [Task("video")], lambda task, context: _count(context)), *Toy.steps)
    cpu_s_per_megapixel = 100.0


def _count(context: TaskContext) -> TaskResult:
    return {"frames": sum(1 for _ in context.frames("video"))}


def test_a_report_uses_the_frames_of_the_first_step(
    blobs: DiskBlobs, info: MediaInfo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("ALONE_EVERY", 10), ("SHARE", 0.5), ("MOST_PAIRS", 4)):
        monkeypatch.setattr(sampling, name, value)
    output = OutputSpec("mp4", 12, report=True)
    with Renderer(blobs, tmp_path / "scratch", lambda name: Scanning()) as renderer:
        scan = order_of(info, Task("video"), step="scan", output=output)
        kept = renderer.run(scan).artefacts
        assert len(kept) == 4 and not renderer.run(replace(scan, output=OutputSpec())).artefacts
        _, last = render(renderer, info, output=output)
        decoded, used = (renderer.run(replace(last, artefacts=names)) for names in ({}, kept))
        blobs.put(next(iter(kept.values())), b"")
        assert renderer.run(replace(last, artefacts=kept)).fault, "the kept frames are what is read"
    quality = used.result["quality"]
    assert quality == decoded.result["quality"] and quality["pairs"] == 4
    assert quality["alone_pairs"] == 2 and 0.5 < quality["flicker_of_alone"] < 1.5
    assert blobs.get(used.files["sheet"][0]) == blobs.get(decoded.files["sheet"][0])


def test_an_outcome_lists_results_and_files(renderer: Renderer, info: MediaInfo, blobs: DiskBlobs) -> None:
    outcome = renderer.run(order_of(info, tasks_of(info)[0], records_reads=True))
    prefix = "jobs/job_1/invert/run-0/att_run-0/"
    assert outcome.segment and outcome.segment.startswith(prefix)
    assert set(outcome.files) == {"colours.json", "preview"}
    assert re.fullmatch(f"{prefix}run-0-[0-9a-f]{{24}}[.]npz", outcome.artefacts["invert/run-0"])
    assert all(blobs.size(key) for key in (*outcome.artefacts.values(), *(key for key, _ in outcome.files.values())))
    preview = cv2.imdecode(np.frombuffer(blobs.get(outcome.files["preview"][0]), np.uint8), cv2.IMREAD_COLOR)
    assert preview.shape == (64, 96, 3)
    assert {"decode", "encode", "invert", "method", "store"} <= outcome.stages.keys()
    assert 0 < outcome.stages[CPU] < 60
    assert 1e7 < outcome.stages[PEAK_MEMORY] < 1e11
    assert 0 <= outcome.stages["invert"] <= outcome.stages["method"]
    assert "job_1 tsk_run-0 att_run-0" in outcome.log
    assert "inverting from 0" in outcome.log


def test_reports_from_helper_threads_arrive(renderer: Renderer, info: MediaInfo) -> None:
    log = renderer.run(order_of(info, tasks_of(info)[0], params={"fault": "helped"})).log
    assert "helping with 3" in log
    assert "not of this task" not in log


def test_the_same_order_gives_the_same_bytes(info: MediaInfo, blobs: DiskBlobs, tmp_path: Path) -> None:
    made = []
    for attempt in ("a", "b"):
        with Renderer(blobs, tmp_path / "scratch", lambda name: Toy()) as renderer:
            outcomes, last = render(renderer, info)
            outcomes.append(renderer.run(replace(last, attempt_id=attempt)))
        keys = [k for o in outcomes for k in (o.segment, *o.artefacts.values(), *(k for k, _ in o.files.values())) if k]
        made.append([blobs.get(key) for key in keys])
    assert made[0] == made[1]


@pytest.mark.parametrize(("form", "kind"), [("png", "application/zip"), ("webm", "video/webm")])
def test_frames_are_encoded_in_other_formats(
    form: str, kind: str, renderer: Renderer, info: MediaInfo, blobs: DiskBlobs
) -> None:
    _outcomes, last = render(renderer, info, output=OutputSpec(form))
    done = renderer.run(last)
    assert done.fault is None, done
    key, media_type = done.files["result"]
    assert media_type == kind
    assert (done.result["frames"], done.result["fps"]) == (TINY_FRAMES, pytest.approx(12, abs=0.05))
    with blobs.local(key) as path, VideoReader(path) as reader:
        assert (reader.frames, reader.size) == (TINY_FRAMES, (96, 64))


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ("twice", "bad-emission"),
        ("skip", "bad-emission"),
        ("drop-last", "bad-emission"),
        ("small", "bad-frame"),
        ("raise", "internal-error"),
    ],
)
def test_a_failing_step_reports_its_error_code(fault: str, code: str, renderer: Renderer, info: MediaInfo) -> None:
    outcome = renderer.run(order_of(info, tasks_of(info)[0], params={"fault": fault}))
    assert outcome.fault and outcome.fault.code == code
    assert outcome.segment is None
    assert not outcome.cancelled
    assert "Traceback" in outcome.log


def test_a_user_error_is_logged_as_a_one_line_warning(
    renderer: Renderer, info: MediaInfo, caplog: pytest.LogCaptureFixture
) -> None:
    outcome = renderer.run(order_of(info, tasks_of(info)[0], params={"fault": "unwilling"}))
    assert outcome.fault and outcome.fault.code == "bad-media"
    logged = [record for record in caplog.records if "failed" in record.getMessage()]
    assert [(record.levelname, record.exc_info) for record in logged] == [("WARNING", None)]
    assert "There is no cat in it." in outcome.log and "Add a cat." in outcome.log
    assert "Traceback" not in outcome.log


def test_an_unexpected_error_is_logged_with_its_traceback(
    renderer: Renderer, info: MediaInfo, caplog: pytest.LogCaptureFixture
) -> None:
    outcome = renderer.run(order_of(info, tasks_of(info)[0], params={"fault": "raise"}))
    (logged,) = [record for record in caplog.records if "failed" in record.getMessage()]
    assert logged.levelname == "ERROR" and logged.exc_info
    assert "in _raise" in outcome.log


def test_errors_of_parameters_and_inputs_name_their_field(renderer: Renderer, info: MediaInfo) -> None:
    first = tasks_of(info)[0]
    wrong = renderer.run(order_of(info, first, params={"brush": 3})).fault
    assert wrong and (wrong.code, wrong.field) == ("bad-parameter", "params.brush")
    gone = renderer.run(order_of(info, first, inputs={})).fault
    assert gone and (gone.code, gone.field) == ("bad-parameter", "inputs.video")


def test_cancelling_takes_less_than_a_second(renderer: Renderer, info: MediaInfo) -> None:
    stop = threading.Event()
    threading.Timer(0.3, stop.set).start()
    begin = time.monotonic()
    outcome = renderer.run(order_of(info, tasks_of(info)[0], params={"fault": "hang"}), cancelled=stop.is_set)
    assert outcome.cancelled
    assert outcome.fault is None
    assert time.monotonic() - begin < 1.3


def test_progress_rises_to_at_most_one(renderer: Renderer, info: MediaInfo) -> None:
    reports: list[float] = []
    renderer.run(order_of(info, tasks_of(info)[0]), report=lambda done, preview="": reports.append(done))
    assert reports and all(0 <= done <= 1 for done in reports)


def test_a_running_task_publishes_its_newest_frames(
    renderer: Renderer, info: MediaInfo, blobs: DiskBlobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workers.execution.preview_publisher.EVERY_S", 0.0)
    shown: list[np.ndarray[Any, Any]] = []

    def keep_preview(done: float, preview: str = "") -> None:
        if preview:
            shown.append(cv2.imdecode(np.frombuffer(blobs.get(preview), np.uint8), cv2.IMREAD_COLOR))

    outcome = renderer.run(order_of(info, tasks_of(info)[0]), report=keep_preview)
    assert len(shown) == RUN
    assert {picture.shape for picture in shown} == {(64, 96, 3)}
    assert np.abs(shown[0].astype(int) - shown[-1]).max() > 50, "another frame each time"
    live = [key for key in blobs.keys("jobs/") if "/live-" in key]
    assert [key.rpartition("/")[2] for key in live] == ["live-7.jpg", "live-8.jpg", "live-9.jpg"]
    assert not set(live) & {key for key, _ in outcome.files.values()}, "none of them outlives the job"


def test_a_video_that_is_shorter_than_announced_ends_the_last_task(renderer: Renderer, info: MediaInfo) -> None:
    longer = replace(info, frames=TINY_FRAMES + 4)
    state = renderer.run(order_of(info, tasks_of(info)[0])).artefacts
    state |= renderer.run(order_of(info, tasks_of(info)[1], state)).artefacts
    outcome = renderer.run(order_of(longer, tasks_of(longer)[2], state))
    assert outcome.fault is None, outcome
    assert outcome.result["emitted"] == [20, TINY_FRAMES]
    assert "the video ended at frame 24" in outcome.log


def test_a_task_beyond_the_end_of_the_video_writes_nothing(renderer: Renderer, info: MediaInfo) -> None:
    longer = replace(info, frames=40)
    state = renderer.run(order_of(info, tasks_of(info)[0])).artefacts
    state = {"invert/run-20": state["invert/run-0"]}
    outcome = renderer.run(order_of(longer, tasks_of(longer)[3], state))
    assert outcome.fault is None, outcome
    assert outcome.segment is None


def test_inputs_are_read_as_images_and_json(info: MediaInfo, blobs: DiskBlobs) -> None:
    masks = io.BytesIO()
    with zipfile.ZipFile(masks, "w") as archive:
        archive.writestr("mask_0007.png", cv2.imencode(".png", np.full((64, 96), 900, np.uint16))[1].tobytes())
        archive.writestr("mask_0002.png", encode_png(np.full((64, 96, 3), (1, 2, 3), np.uint8)))
    blobs.put("assets/masks", masks.getvalue())
    blobs.put("assets/json", b'{"a": 1}')
    inputs: dict[str, Any] = {}

    def read_inputs(task: Task, context: TaskContext) -> TaskResult:
        found = context.images("masks")
        inputs.update(numbers=list(found), deep=found[7], colour=found[2], json=context.json("json"))
        inputs.update(first=context.image("video"), has=context.has("style"), wants=context.wants("svg"))
        return {}

    def one(context: PlanContext) -> Sequence[Task]:
        return [Task("analyze")]

    class Reader(Toy):
        steps = (Step("invert", "Read", one, read_inputs),)

    inputs = {"video": "assets/video", "masks": "assets/masks", "json": "assets/json"}
    with Renderer(blobs, None, lambda name: Reader()) as renderer:
        outcome = renderer.run(order_of(info, Task("analyze"), inputs=inputs))
    assert outcome.fault is None, outcome
    assert inputs["numbers"] == [2, 7]
    assert inputs["deep"].dtype == np.uint16
    assert int(inputs["deep"][0, 0]) == 900
    assert tuple(inputs["colour"][0, 0]) == (1, 2, 3)
    assert (inputs["json"], inputs["has"], inputs["wants"]) == ({"a": 1}, False, True)
    assert inputs["first"].shape == (64, 96, 3)


def test_a_result_without_frames_raises_a_fault(renderer: Renderer, info: MediaInfo) -> None:
    outcome = renderer.run(order_of(info, Task("assemble"), step="assemble"))
    assert outcome.fault and outcome.fault.code == "unreadable-media"


@pytest.mark.real("chromium")
def test_chromium_plays_the_result(renderer: Renderer, info: MediaInfo, blobs: DiskBlobs) -> None:
    from playwright.sync_api import sync_playwright

    _outcomes, last = render(renderer, info)
    done = renderer.run(last)
    page_text = """<video muted></video><script>
      const video = document.querySelector('video');
      window.played = new Promise((yes, no) => { video.onended = () => yes([video.videoWidth, video.videoHeight,
        video.duration, video.webkitAudioDecodedByteCount]); video.onerror = () => no(video.error.message); });
      video.src = '%s'; video.play();</script>"""
    with sync_playwright() as playwright, blobs.local(done.files["result"][0]) as path:
        browser = playwright.chromium.launch(
            executable_path=shutil.which(SHELL) or shutil.which("chromium"), args=CHROMIUM_ARGS
        )
        page = browser.new_page()
        page.route(
            "http://impasto.test/", lambda route: route.fulfill(body=page_text % "/result", content_type="text/html")
        )
        page.route("http://impasto.test/result", lambda route: route.fulfill(path=path, content_type="video/mp4"))
        page.goto("http://impasto.test/")
        width, height, seconds, sound = page.evaluate("window.played")
        browser.close()
    assert (width, height) == (96, 64)
    assert seconds == pytest.approx(2.0, abs=0.06)
    assert sound > 0
