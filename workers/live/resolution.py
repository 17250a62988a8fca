"""Selects the working resolution: it is reduced before the latency grows. Pure: times are arguments.

Step down: after two consecutive frames that took more than two periods; or when more than two frames and more than one
in twenty of the last two seconds were late, or more than three and one in a hundred of the last ten seconds; or when
one stage (analysis, painting) takes longer than a period, at the median of half a second, so that frames are dropped. A
step down may skip rungs.

Step up by one rung: when the next larger size has been expected to fit for some seconds, including its slowest
twentieth of frames. This time doubles with each failed attempt at that size.

The cost of a frame without decoding is assumed to grow with the side length to the power of 1.2. Measured between
352x288 and 640x480, it grows with the number of pixels to the power of 0.5 to 0.7. If one step down does not suffice,
another follows.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Literal

from workers.live.model import Size

Reason = Literal["slow", "room"]


@dataclass(frozen=True)
class SizeReason:
    """Reason why frames are painted at the present size."""

    reason: Literal["slow", "room", "input"] = "input"
    """Missed deadlines, spare time, or the size of the incoming frames."""
    latency_s: float = 0.0
    """Delay that 95 % of the latest frames at the previous size did not exceed, seconds; 0 with "input"."""
    deadline_s: float = 0.0
    """Delay that was allowed, seconds; 0 with "input"."""


SCALES = (1.0, 0.75, 0.5, 0.375, 0.25)
"""Rungs of the ladder: factors of both sides."""
SETTLE_S = 0.3
"""Seconds at the start of a stream that are not measured: the first frames are segmented without history, and memory is
touched for the first time."""
NOTICED_S = 1 / 30
"""A delay below this (seconds) does not justify a smaller size."""
RECENT_S = 0.5
"""Length of the period whose frames count as recent, seconds."""
LATE_WINDOWS = ((2.0, 2, 0.05), (10.0, 3, 0.01))
"""(seconds, late frames, share of all frames): in the long run less than one frame in a hundred is late."""
MARGIN = 0.85
"""A size fits if its frames are expected to take at most this share of the available time."""
TAIL = 0.95
AIM = 0.9
"""Frames that took longer than this share of the deadline count as late, because sending and attempts at a larger size
need time as well."""
FITTING_S, MOST_FITTING_S = 3.0, 120.0
"""Time for which the next larger size must be expected to fit before a step up, judged by the frames of that time, and
its maximum after failures, seconds."""
STABLE_S = 60.0
"""Seconds. A step up that is reversed before this time has failed; one that lasts longer clears earlier failures."""
ENOUGH = 4
"""Frames needed for a median."""
MIN_SIDE_PX = 16
_LATE_PERIODS = 2.0
_RATE_WINDOW_S = 1.0
_GROWTH = 1.2
_KEPT_S = 10.0
MOST_KEPT = 1200


def deadline_s(period_s: float) -> float:
    """Deadline of a frame, seconds: one period, or a thirtieth of a second where that is at most two periods."""
    return min(2 * period_s, max(period_s, NOTICED_S))


def scaled(size: Size, scale: float) -> Size:
    """`size` at a rung. Below full size, sides are even, as all codecs accept."""
    if scale >= 1.0:
        return size
    width, height = (max(MIN_SIDE_PX, 2 * round(side * scale / 2)) for side in size)
    return width, height


class FrameRateMeter:
    """The actual frame rate of the client, from arrival times."""

    def __init__(self, most_fps: float) -> None:
        self._most = most_fps
        self._times: deque[float] = deque(maxlen=256)

    def arrived(self, now_s: float) -> None:
        self._times.append(now_s)
        while self._times[0] < now_s - _RATE_WINDOW_S:
            self._times.popleft()

    @property
    def period_s(self) -> float:
        """Seconds from a frame to the next, at least the period of the announced rate."""
        if len(self._times) < 3:
            return 1.0 / self._most
        spread = self._times[-1] - self._times[0]
        return max(spread / (len(self._times) - 1), 1.0 / self._most)


@dataclass(frozen=True)
class FrameCost:
    """Seconds of work for a frame."""

    decode_s: float
    analyze_s: float
    paint_s: float
    """Time of painting, including filter and encoding, seconds."""

    @classmethod
    def of(cls, stages_s: Mapping[str, float]) -> FrameCost:
        stage = stages_s.get
        paint_s = stage("paint", 0.0) + stage("filter", 0.0) + stage("encode", 0.0)
        return cls(stage("decode", 0.0), stage("analyze", 0.0), paint_s)

    @property
    def half_s(self) -> float:
        """The longer of the two stages, which limits the frame rate."""
        return max(self.decode_s + self.analyze_s, self.paint_s)

    @property
    def whole_s(self) -> float:
        return self.decode_s + self.analyze_s + self.paint_s

    def at(self, factor: float) -> FrameCost:
        """Expected cost if the sides of the working size change by `factor`."""
        growth = factor**_GROWTH
        return FrameCost(self.decode_s, self.analyze_s * growth, self.paint_s * growth)

    def fits(self, period_s: float, margin: float = MARGIN) -> bool:
        return self.half_s <= margin * period_s and self.whole_s <= margin * deadline_s(period_s)


@dataclass(frozen=True)
class _Sample:
    at_s: float
    latency_s: float
    cost: FrameCost


@dataclass
class ResolutionLadder:
    """
    Args:
        adaptive: False: full size, always.
    """

    adaptive: bool = True
    rung: int = 0
    _samples: deque[_Sample] = field(default_factory=lambda: deque(maxlen=MOST_KEPT))
    _late: int = 0
    _since_s: float | None = None
    """Time at which the present size was chosen."""
    _fails: list[int] = field(default_factory=lambda: [0] * len(SCALES))
    """Failed steps up, by the rung that was tried."""
    _stepped_up_s: float | None = None
    why: SizeReason = SizeReason()
    """Reason for the present size."""

    @property
    def scale(self) -> float:
        return SCALES[self.rung]

    def painted(self, now_s: float, period_s: float, latency_s: float, cost: FrameCost, rung: int) -> Reason | None:
        """A frame that was begun at `rung` is finished. Returns the reason if the rung has changed.

        Args:
            period_s: between frames of the client.
            latency_s: from the arrival of the frame until it was painted.
        """
        if rung != self.rung:
            return None
        if self._since_s is None:
            self._since_s = now_s + SETTLE_S
        if now_s < self._since_s:
            return None
        self._keep(_Sample(now_s, latency_s, cost))
        self._late = self._late + 1 if latency_s > _LATE_PERIODS * period_s else 0
        if not self.adaptive:
            return None
        if self._slow(now_s, period_s):
            self.why = SizeReason("slow", self._tail_s(now_s), deadline_s(period_s))
            return self._step_down(now_s, period_s)
        if self._has_spare_time(now_s, period_s):
            self.why = SizeReason("room", self._tail_s(now_s), deadline_s(period_s))
            return self._step_up(now_s)
        return None

    def is_behind(self, now_s: float, period_s: float) -> bool:
        """Whether the next frame must start before this one is painted to keep the rate; False until enough frames are
        measured."""
        costs = [sample.cost.whole_s for sample in self._samples if sample.at_s >= now_s - RECENT_S]
        return len(costs) >= ENOUGH and median(costs) > MARGIN * period_s

    def restart(self) -> None:
        """Another worker has taken over: discard the measurements."""
        self._measure_anew(None)

    def _keep(self, sample: _Sample) -> None:
        self._samples.append(sample)
        while self._samples[0].at_s < sample.at_s - _KEPT_S:
            self._samples.popleft()

    def _slow(self, now_s: float, period_s: float) -> bool:
        if self.rung == len(SCALES) - 1:
            return False
        if self._late >= 2 or self._often_late(now_s, period_s):
            return True
        assert self._since_s is not None
        samples = [sample for sample in self._samples if sample.at_s >= now_s - RECENT_S]
        if now_s - self._since_s < RECENT_S or len(samples) < 2:
            return False
        return median(sample.cost.half_s for sample in samples) > period_s

    def _often_late(self, now_s: float, period_s: float) -> bool:
        """More than a few frames, and more than a share of all, missed the deadline."""
        aim_s = AIM * deadline_s(period_s)
        if self._samples[-1].latency_s <= aim_s:
            return False
        ages = [(now_s - sample.at_s, sample.latency_s > aim_s) for sample in self._samples]
        for window_s, few, share in LATE_WINDOWS:
            late_frames = [late for age_s, late in ages if age_s <= window_s]
            if sum(late_frames) > max(few, share * len(late_frames)):
                return True
        return False

    def _has_spare_time(self, now_s: float, period_s: float) -> bool:
        if self.rung == 0 or self._since_s is None:
            return False
        fitting_s = min(FITTING_S * 2 ** self._fails[self.rung - 1], MOST_FITTING_S)
        if now_s - self._since_s < fitting_s:
            return False
        growth = SCALES[self.rung - 1] / self.scale
        usual = self._frame_cost_quantile(0.75, now_s)
        return usual.at(growth).fits(period_s) and self._tail_s(now_s) * growth <= AIM * deadline_s(period_s)

    def _tail_s(self, now_s: float) -> float:
        """95th percentile of the latency of recent frames, from arrival to answer."""
        latest = sorted(sample.latency_s for sample in self._samples if sample.at_s >= now_s - FITTING_S)
        return latest[int(TAIL * (len(latest) - 1))]

    def _frame_cost_quantile(self, part: float, now_s: float) -> FrameCost:
        """The quantile `part` of the latest frame times."""
        latest = [sample.cost for sample in self._samples if sample.at_s >= now_s - FITTING_S]
        costs = sorted(latest, key=lambda cost: cost.whole_s)
        return costs[int(part * (len(costs) - 1))]

    def _step_down(self, now_s: float, period_s: float) -> Reason:
        lasted_s = STABLE_S if self._stepped_up_s is None else now_s - self._stepped_up_s
        self._fails[self.rung] += lasted_s < STABLE_S
        self.rung = self.rung + 1 if lasted_s < STABLE_S else self._fitting(now_s, period_s)
        self._stepped_up_s = None
        self._measure_anew(now_s)
        return "slow"

    def _fitting(self, now_s: float, period_s: float) -> int:
        """The highest lower rung at which frames are expected to meet the deadline."""
        usual = self._frame_cost_quantile(0.5, now_s)
        below = range(self.rung + 1, len(SCALES))
        return next((r for r in below if usual.at(SCALES[r] / self.scale).fits(period_s)), len(SCALES) - 1)

    def _step_up(self, now_s: float) -> Reason:
        if self._stepped_up_s is not None and now_s - self._stepped_up_s > STABLE_S:
            self._fails = [0] * len(SCALES)
        self.rung -= 1
        self._stepped_up_s = now_s
        self._measure_anew(now_s)
        return "room"

    def _measure_anew(self, since_s: float | None) -> None:
        self._samples.clear()
        self._late = 0
        self._since_s = since_s
