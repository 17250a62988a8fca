"""Step "scan": shots and runs of frames, the working grid, and the user's masks, label maps and styles.

It decodes the video once and validates all user inputs, so that a mistake is reported before any expensive work.

Working grid: motion, clusters and warps are computed at reduced resolution, with cells of one to a few pixels.

    a frame of W x H px   ->   w x h working pixels, w = round(W / s), h = round(H / s)

The centre of the top left working pixel is (0, 0), as in a frame. Strokes and colours always have the frame's size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Frame, Labels, Plane
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.holds import first_scanned
from pipeline.methods.masks import mask_plane
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_styles import label_styles
from pipeline.methods.scan import delivered_shots, scan_video

RUN = 12
"""Frames per task. It is small, so that short clips can use many workers."""
REFERENCE_AREA = 45_000
"""Reference frame area, px, from which the scale is derived; a frame of 640 x 344 px is reduced to 320 x 172."""
PAPER_SIDE = 344
"""Shorter side of the paper's frames, px. Stroke sizes refer to it, so that a painting looks alike at any size."""
LABELLED = ("masks", "labels", "label_intervals", "styles")
"""Inputs that refer to clusters or propagate from frame to frame. With one, a piece of a film clusters its whole shots,
so that labels are those of the film."""


def plan_scan(context: PlanContext[PatchesParams]) -> list[Task]:
    """One task for the video and one for the user's inputs, so that a change of inputs does not repeat the scan of the
    video."""
    return [
        Task("video", weight=0.005 * max(context.video.frames, 1)),
        Task("inputs", after=("video",), weight=0.005),
    ]


def run_scan(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Task "video": count the frames and detect cuts. The result holds the number of frames, and the first frame of
    each shot but the first.

    Task "inputs": validate the user's inputs. The result holds the frames with corrected label maps, and how many
    frames before and after each are clustered again (None: the shot).
    """
    if task.key == "inputs":
        count = max(int(context.load("scan", "video")["frames"]), context.video.total)
        validate_inputs(context, count)
        intervals = label_intervals(document(context, "label_intervals", []))
        keys = keyframes(context, "labels", count)
        return {"corrections": {str(key): list(intervals[key]) if key in intervals else None for key in keys}}
    numbered = context.video.is_piece and any(context.has(name) for name in LABELLED)
    held = context.params.frames_per_painting if context.params.temporal == "off" else 1
    first = 0 if numbered else first_scanned(context.video, held)
    stop = context.video.total if numbered else context.video.stop
    span = (first, stop) if context.video.is_piece else (None, None)
    count, cuts = scan_video(context, context.params.cut_sensitivity, span=span)
    context.save("video", {"frames": np.array(count)})
    return {"first": first, "frames": count, "cuts": cuts}


# -- runs of frames


def runs(context: PlanContext[PatchesParams]) -> Iterator[tuple[int, int, int, int]]:
    """(start, stop, shot's begin, shot's end) of every run of frames, in order. A run does not cross a cut."""
    for begin, end in shots(context):
        for start in range(begin, end, RUN):
            yield start, min(start + RUN, end), begin, end


def painting_runs(context: PlanContext[PatchesParams]) -> Iterator[tuple[int, int, int, int]]:
    """(start, stop, shot's begin, shot's end) of every run of frames that one task paints, in order.

    The runs of a shot have nearly equal lengths, so that no worker waits long for another one's last run. Where each
    painting is shown for several frames, all but the last have the greatest possible length instead, because the
    cross-fade to the next run needs it.
    """
    shown = context.params.frames_per_painting
    for begin, end in shots(context):
        if shown == 1:
            count = -(-(end - begin) // RUN)
            starts = [begin + round((end - begin) * k / count) for k in range(count)]
        else:
            starts = list(range(begin, end, RUN // shown * shown))
        for start, stop in pairwise([*starts, end]):
            if context.video.delivers_any(start, stop):
                yield start, stop, begin, end


def shots(context: PlanContext[PatchesParams]) -> Iterator[tuple[int, int]]:
    """First frame of every shot of which a frame is painted, and the frame after its last."""
    return delivered_shots(context, context.results["scan"]["video"])


def run_key(start: int) -> str:
    """Key of the task that processes the run that starts at frame `start`."""
    return f"run-{start:07d}"


def run_start(frame: int, begin: int) -> int:
    """First frame of the run that contains `frame`; `begin` is the first frame of the shot."""
    return begin + (frame - begin) // RUN * RUN


# -- the working grid


@dataclass(frozen=True)
class WorkingGrid:
    """The reduced resolution at which motion, clusters and warps are computed.

    Attributes:
        width, height: size of the frame, px.
        scale: approximate width of a working pixel, px: 1, 1.5, 2, 2.5 ...
    """

    width: int
    height: int
    scale: float

    @classmethod
    def of(cls, size: tuple[int, int]) -> WorkingGrid:
        """The grid for frames of (width, height) px.

        The scale grows more slowly than the frame, so that larger frames keep more detail of the motion.
        """
        width, height = size
        return cls(width, height, max(1.0, round(2 * (width * height / REFERENCE_AREA) ** 0.4) / 2))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in working px, at least 16 each."""
        return max(round(self.width / self.scale), 16), max(round(self.height / self.scale), 16)

    @property
    def ratio(self) -> tuple[float, float]:
        """Exact width and height of a working pixel, px."""
        return self.width / self.size[0], self.height / self.size[1]

    @property
    def unit(self) -> float:
        """Pixels of the frame per pixel of one whose shorter side is `PAPER_SIDE`."""
        return min(self.width, self.height) / PAPER_SIDE

    def small(self, frame: Frame) -> Frame:
        """Reduce a frame to the working size: uint8 (h, w, 3)."""
        if self.size == (self.width, self.height):
            return frame
        return np.asarray(cv2.resize(frame, self.size, interpolation=cv2.INTER_AREA), np.uint8)

    def downscale_flow(self, flow: NDArray[np.float32]) -> NDArray[np.float32]:
        """Reduce the flow of a frame, px, to the working size, working px."""
        if self.size == (self.width, self.height):
            return flow
        small = cv2.resize(flow, self.size, interpolation=cv2.INTER_AREA)
        return np.asarray(small / np.array(self.ratio, np.float32), np.float32)

    def upscale(self, plane: AnyArray) -> AnyArray:
        """Enlarge a smooth plane of the working size to the frame's size, bilinearly."""
        if self.size == (self.width, self.height):
            return plane
        return np.asarray(cv2.resize(plane, (self.width, self.height), interpolation=cv2.INTER_LINEAR))


# -- the user's inputs


def keyframes(context: TaskContext[PatchesParams], name: str, frames: int) -> list[int]:
    """Frame numbers of the images in input `name`, ascending.

    Raises:
        BadParameter: a frame number is outside the video.
    """
    found = sorted(context.images(name)) if context.has(name) else []
    if found and found[-1] >= frames:
        raise BadParameter(
            f"The video has no frame {found[-1]}.", field=f"inputs.{name}[{found[-1]}]", value=found[-1],
            remedy=f"Name the image by a frame number from 0 to {frames - 1}: the last number in its file name.",
        )  # fmt: skip
    return found


def validate_inputs(context: TaskContext[PatchesParams], frames: int) -> None:
    """Validate masks, label maps and styles.

    Raises:
        BadParameter: an image belongs to no frame of the video, has another aspect ratio, or is not gray; or a style
            is unknown.
    """
    grid = WorkingGrid.of(context.size)
    for name, read in (("labels", label_map), ("masks", mask_map)):
        images = context.images(name) if context.has(name) else {}
        for number in keyframes(context, name, frames):
            read(images[number], grid, number)
    label_styles(document(context, "styles", {}))
    label_intervals(document(context, "label_intervals", []))


def document(context: TaskContext[PatchesParams], name: str, missing: JsonValue) -> JsonValue:
    """The JSON input `name`; `missing`, if it is not given."""
    return context.json(name) if context.has(name) else missing


def label_map(image: AnyArray, grid: WorkingGrid, number: int) -> Labels:
    """Convert a corrected label map: int32 (h, w) at the working size. Gray values are labels, 0 = unclustered.

    Args:
        image: uint8 or uint16, (H, W) or (H, W, 3) with equal channels, any size with the aspect ratio of the video.
        number: frame number, for error texts.

    Raises:
        BadParameter: the image is not gray, or has a different aspect ratio than the video.
    """
    field = f"inputs.labels[{number}]"
    if image.ndim == 3 and image.shape[2] >= 3 and (image[..., :3] == image[..., :1]).all():
        image = image[..., 0]
    if image.ndim != 2:
        raise BadParameter(
            "A label map must have one number per pixel.", field=field, value=image.shape,
            remedy="Use a gray image of 8 or 16 bit, such as those of the artefact `labels`.",
        )  # fmt: skip
    _check_aspect(image, grid, field)
    small = cv2.resize(image.astype(np.float32), grid.size, interpolation=cv2.INTER_NEAREST)
    return np.rint(small).astype(np.int32)


def mask_map(image: AnyArray, grid: WorkingGrid, number: int) -> Plane:
    """Convert a foreground mask: float32 (h, w) at the working size, 1 = foreground, 0 = background, NaN = unknown.

    Gray (between 0.25 and 0.75) and transparent pixels are unknown, so that scribbles can be used as masks. In a mask
    in colours, every colour but black is foreground.

    Args:
        image: uint8 or uint16, (H, W), (H, W, 3) or (H, W, 4), any size with the aspect ratio of the video.
        number: frame number, for error texts.

    Raises:
        BadParameter: the image has a different aspect ratio than the video.
    """
    field = f"inputs.masks[{number}]"
    top = np.float32(np.iinfo(image.dtype).max)
    gray = mask_plane(image)
    _check_aspect(gray, grid, field)
    unknown = (gray > 0.25) & (gray < 0.75)
    if image.ndim == 3 and image.shape[2] == 4:
        unknown |= image[..., 3] < top / 2
    mask = np.where(unknown, np.nan, gray > 0.5).astype(np.float32)
    return np.asarray(cv2.resize(mask, grid.size, interpolation=cv2.INTER_NEAREST), np.float32)


def _check_aspect(image: AnyArray, grid: WorkingGrid, field: str) -> None:
    height, width = image.shape[:2]
    if abs(width * grid.height - height * grid.width) > max(grid.width, grid.height):
        raise BadParameter(
            "The image has a different aspect ratio than the video.", field=field, value=f"{width}x{height}",
            remedy=f"Use {grid.width}x{grid.height} px, or the same aspect ratio.",
        )  # fmt: skip


def label_intervals(given: JsonValue) -> dict[int, tuple[int, int]]:
    """Frame -> how many frames before and after it its corrected label map changes, from the document
    "label_intervals".

    Raises:
        BadParameter: it is no list of objects with the numbers frame, before and after.
    """
    found = {}
    for place, row in enumerate(given if isinstance(given, list) else [None]):
        values = [row.get(name) for name in ("frame", "before", "after")] if isinstance(row, dict) else []
        numbers = [value for value in values if isinstance(value, int) and not isinstance(value, bool) and value >= 0]
        if len(numbers) != 3:
            raise BadParameter(
                "An interval has the frame numbers frame, before and after, each 0 or more.",
                field=f"inputs.label_intervals[{place}]", value=str(row)[:100],
                remedy='For example [{"frame": 40, "before": 10, "after": 12}].',
            )  # fmt: skip
        found[numbers[0]] = (numbers[1], numbers[2])
    return found
