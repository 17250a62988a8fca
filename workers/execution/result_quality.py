"""The quality report of a job: measures of its result, compared with source frames that the first step has saved."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

from pipeline.errors import ImpastoError
from pipeline.frames import Frame
from pipeline.methods.base import AnyParams, Method, VideoInfo
from pipeline.methods.local import Input, LocalContext, run_plan
from pipeline.quality.palette import PictureColours
from pipeline.quality.report import FramePair, QualityReport
from pipeline.quality.sampling import SampleSize, affordable_sample, job_pairs
from pipeline.video.contact_sheet import SHEET_TILE_PX, fit, sheet_frames
from pipeline.video.reader import VideoReader
from workers.blobs.base import Blobs
from workers.contract.order import TaskOrder
from workers.execution.arrays import read_arrays
from workers.execution.context import AttemptContext
from workers.execution.decoders import Decoders
from workers.execution.pair_recorder import pair_name
from workers.jobs.frame_window import video_info, window_document


def report_pairs(order: TaskOrder, chosen: Method) -> list[int]:
    """Second frames of the frame pairs that the job's report measures; empty without a report."""
    video: VideoInfo = video_info(order.input_info["video"])
    if not order.output.report or video.frames < 2:
        return []
    return job_pairs(video.frames, sheet_frames(video.frames), sample_size(video, order, chosen).pairs)


def sample_size(video: VideoInfo, order: TaskOrder, chosen: Method) -> SampleSize:
    """Number of measurements in the quality report of a job with this video. If there are drawn pictures (keys, masks,
    label maps), frames are not also painted independently."""
    drawn = any(spec.kind == "images" and spec.name in order.inputs for spec in chosen.inputs)
    return affordable_sample(video.frames, (video.width, video.height), chosen.cpu_s_per_megapixel, not drawn)


class ResultQuality:
    """Measures the result of a job.

    Args:
        order: order of the job's last step.
        scratch: a folder for files while they are used.

    Attributes:
        tiles: frames of the contact sheet that were decoded on the way, fitted, by index.
    """

    def __init__(self, order: TaskOrder, chosen: Method, blobs: Blobs, decoders: Decoders, scratch: Path) -> None:
        self._order, self._method, self._blobs, self._decoders = order, chosen, blobs, decoders
        self._scratch = scratch
        self._kept = {name.partition("/")[2]: key for name, key in order.artefacts.items()}
        self.tiles: dict[int, Frame] = {}

    def measure(self, result: Path, params: AnyParams) -> QualityReport:
        """The report of the file `result`. `params`: the method's validated Params."""
        pairs = report_pairs(self._order, self._method)
        size = sample_size(video_info(self._order.input_info["video"]), self._order, self._method)
        report = QualityReport(sampled=True, search_faces=size.faces, palette=self._palette(params))
        with VideoReader(result) as painted:
            alone = {pairs[(2 * i + 1) * len(pairs) // (2 * size.alone)] for i in range(size.alone)}  # evenly spread
            sheet = set(sheet_frames(painted.frames))
            for frame in pairs:
                after = tuple(painted.read(frame - 1, frame + 1)) if frame < painted.frames else ()
                for index, picture in enumerate(after, frame - 1):
                    if index in sheet:
                        self.tiles[index] = fit(picture, SHEET_TILE_PX)
                before = self._source(frame)
                if len(before) == len(after) == 2 and before[0].shape == after[0].shape:
                    single = self._painted_alone(frame, before, params) if frame in alone else None
                    report.add(frame, before, after, single)
        return report

    def _source(self, frame: int) -> tuple[Frame, ...]:
        """Source frames `frame` - 1 and `frame`, as the first step saved them, otherwise decoded."""
        key = self._kept.get(pair_name(frame))
        if key is not None:
            arrays = read_arrays(self._blobs.get(key))
            return arrays["before"], arrays["now"]
        first = self._order.frames[0] if self._order.frames else 0
        with self._decoders.reader(self._order.inputs["video"], 0, self._order.reading) as source:
            return tuple(source.read(first + frame - 1, first + frame + 1))

    def _painted_alone(self, frame: int, source: FramePair, params: AnyParams) -> FramePair | None:
        """Both frames, each painted by the method as a video of one frame; None if the method cannot."""
        first = self._order.frames[0] if self._order.frames else 0
        try:
            alone = [self._paint(picture, first + frame - 1 + i, params) for i, picture in enumerate(source)]
        except ImpastoError:
            return None
        return alone[0], alone[1]

    def _paint(self, picture: Frame, number: int, params: AnyParams) -> Frame:
        single = self._method.single_frame_params(params.at(number))
        context = LocalContext(single, [picture], self._inputs(number, single), self._order.seed)
        run_plan(self._method, context)
        return context.emitted[0]

    def _inputs(self, number: int, params: AnyParams) -> dict[str, Input]:
        """The job's other inputs for frame `number` of the video."""
        specs = [spec for spec in self._method.inputs_of(params)[1:] if spec.name in self._order.inputs]
        found: dict[str, Input] = {}
        with closing(self._context(number, params)) as context:
            for spec in specs:
                if spec.kind == "json":
                    found[spec.name] = window_document(context.json(spec.name), (number, number + 1))
                elif spec.kind == "video":
                    found[spec.name] = list(context.frames(spec.name, number, number + 1))
                else:
                    found[spec.name] = list(context.frames(spec.name, 0, 1))
        return found

    def _context(self, number: int, params: AnyParams) -> AttemptContext:
        order = replace(self._order, frames=(number, number + 1))
        return AttemptContext(
            order, params, self._blobs, self._decoders, self._scratch, _ignore_progress, lambda: False
        )

    def _palette(self, params: AnyParams) -> PictureColours | None:
        """Colours of the input that the method names as the source of colours, if it is given."""
        name = self._method.palette_input
        if name not in self._order.inputs:
            return None
        with self._decoders.reader(self._order.inputs[name]) as reader:
            picture = next(reader.read(0, 1), None)
        return None if picture is None else PictureColours(picture)


def _ignore_progress(done: float, preview: str = "") -> None:
    """Progress function for frames that are painted alone; does nothing."""
