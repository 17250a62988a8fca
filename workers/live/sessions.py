"""The live sessions of a service: methods, limits, reserved slots, and a `Stream` for a checked order. Numbers may be
read in any thread; everything else is for one event loop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.errors import BadParameter, together
from pipeline.frames import MIN_SIDE_PX
from pipeline.methods import method, methods, parse_params
from pipeline.methods.base import InputKind, Method
from workers.contract.record import Asset, asset_key
from workers.contract.request import Json
from workers.live.codecs import CODECS
from workers.live.model import FilterOrder, LiveOrder, Size, WireFormat
from workers.live.stream import Stream
from workers.live.worker import LiveWorkers, NoLiveWorker
from workers.process.fair_slots import fair_share
from workers.settings import FarmSettings

RETRY_AFTER_S = 5.0
_FITS: Mapping[InputKind, tuple[str, ...]] = {
    "image": ("image", "video"),
    "image-or-video": ("image", "video", "archive"),
    "json": ("json",),
}
"""Kinds of input that a live method can be given, and the kinds of asset that fit."""


@dataclass(frozen=True)
class LiveLimits:
    """Limits of a session's frames."""

    side_px: int
    """Longest side of a frame."""
    fps: float
    frame_bytes: int
    """Bytes of one payload."""


class SessionSlot:
    """A reserved slot for one session."""

    def __init__(self, live: LiveSessions, owner: str | None) -> None:
        self._live: LiveSessions | None = live
        self._owner = owner

    def release(self) -> None:
        """A second call has no effect."""
        if self._live is not None:
            self._live.leave(self._owner)
            self._live = None


class LiveSessions:
    """All live sessions of this process.

    Args:
        workers: source of the sessions' workers.
        settings: maximum number of sessions, and the limits of their frames.
    """

    receives = CODECS
    sends = CODECS

    def __init__(self, workers: LiveWorkers, settings: FarmSettings) -> None:
        self._workers = workers
        self.capacity = settings.live_sessions
        self.limits = LiveLimits(settings.live_max_side_px, settings.live_max_fps, settings.live_frame_bytes)
        self.sessions = 0
        """Number of reserved slots."""
        self._by_owner: Counter[str] = Counter()

    def start(self) -> None:
        """Start the workers. Call on the main thread."""
        if self.capacity:
            self._workers.start()

    def stop(self) -> None:
        self._workers.stop()

    @property
    def free(self) -> int:
        return max(0, self.capacity - self.sessions)

    def methods(self) -> tuple[str, ...]:
        """Names of the causal methods."""
        return tuple(name for name, found in methods().items() if _causal(found))

    def filters(self) -> tuple[str, ...]:
        """Names of the methods that can filter the frames that a live method paints."""
        return tuple(name for name, found in methods().items() if _filters(found))

    def place(self, owner: str | None = None, most: int | None = None) -> SessionSlot:
        """Reserve a slot for a session.

        Args:
            owner: who uses it, for a share of the slots (`fair_share`); None: the only user, who may use all.
            most: the owner's own limit, instead of a share.

        Raises:
            NoLiveWorker: all slots are reserved, or the owner has its share.
        """
        own = 0 if owner is None else self._by_owner[owner]
        allowed = own < most if most is not None else owner is None or fair_share(self.free, own)
        if not self.free or not allowed:
            held = f"You have {own} of {self.capacity} live sessions, and the rest is reserved for others."
            raise NoLiveWorker(
                held if self.free else f"All {self.capacity} live sessions are in use.",
                retry_after_s=RETRY_AFTER_S,
                remedy=f"End one, or try again in {RETRY_AFTER_S:g} s.",
            )
        self.sessions += 1
        if owner is not None:
            self._by_owner[owner] += 1
        return SessionSlot(self, owner)

    def leave(self, owner: str | None) -> None:
        """A slot of this owner is free again."""
        self.sessions -= 1
        if owner is not None:
            self._by_owner -= Counter([owner])

    def order(
        self,
        name: str,
        params: Mapping[str, Json],
        assets: Mapping[str, Asset],
        seed: int,
        size: Size,
        wire: WireFormat,
    ) -> LiveOrder:
        """A checked order. Raises BadParameter."""
        chosen = method(name)
        if not _causal(chosen):
            remedy = f"Use one of: {', '.join(self.methods())}."
            raise BadParameter("This method cannot run live.", field="method", value=name, remedy=remedy)
        self._check_size(size)
        self._check_rate(wire.fps)
        inputs = self.inputs(chosen.name, assets)
        return LiveOrder(name, self.params(name, params), seed, inputs, size, wire, self.limits.side_px)

    def filter(self, name: str, params: Mapping[str, Json]) -> FilterOrder:
        """A checked order of a filter. Raises BadParameter."""
        known = self.filters()
        if name not in known:
            remedy = f"Use one of: {', '.join(known)}."
            raise BadParameter("This method is not a live filter.", field="filter.method", value=name, remedy=remedy)
        try:
            return FilterOrder(name, self.params(name, params))
        except BadParameter as error:
            error.field = f"filter.{error.field}"
            raise

    @staticmethod
    def params(name: str, params: Mapping[str, Json]) -> dict[str, Json]:
        """All parameters of the method, with defaults filled in.

        Raises: BadParameter, also for a parameter without effect on a stream.
        """
        chosen = method(name)
        parsed = parse_params(chosen, params)
        film, stream = (chosen.ineffective(parsed, {"video"}, way, True) for way in (False, True))
        if lost := [found for found in stream if found not in film]:
            raise together([
                BadParameter(found.message, field=found.field, value=found.value, remedy=found.remedy) for found in lost
            ])  # fmt: skip
        return parsed.model_dump(mode="json")

    @staticmethod
    def inputs(name: str, assets: Mapping[str, Asset]) -> dict[str, str]:
        """Blob keys by input name. Raises BadParameter for an input that a live session cannot have."""
        specs = {
            spec.name: spec for spec in method(name).inputs
            if spec.name != "video" and spec.kind in _FITS and not any(when.way for when in spec.applies_when)
        }  # fmt: skip
        for given, asset in assets.items():
            if given not in specs:
                known = ", ".join(specs) or "none"
                raise BadParameter(
                    f"A live session of {name!r} has no input {given!r}.",
                    field=f"inputs.{given}", remedy=f"Its inputs are: {known}.",
                )  # fmt: skip
            fits = _FITS[specs[given].kind]
            if asset.kind not in fits:
                raise BadParameter(
                    f"The input {given!r} needs an asset of kind {specs[given].kind}; this one has kind {asset.kind}.",
                    field=f"inputs.{given}", value=asset.id, remedy=f"Use an asset of kind: {', '.join(fits)}.",
                )  # fmt: skip
        return {given: asset_key(asset.id) for given, asset in assets.items()}

    def stream(self, order: LiveOrder, adaptive: bool) -> Stream:
        """A stream that can be opened. Its slot has been reserved before."""
        return Stream(self._workers, order, adaptive)

    def _check_size(self, size: Size) -> None:
        for name, side in zip(("width", "height"), size, strict=True):
            if not MIN_SIDE_PX <= side <= self.limits.side_px:
                remedy = f"Use {MIN_SIDE_PX} to {self.limits.side_px} px."
                raise BadParameter(f"The {name} is out of range.", field=name, value=side, remedy=remedy)

    def _check_rate(self, fps: float) -> None:
        if not 0 < fps <= self.limits.fps:
            remedy = f"Use a rate above 0, up to {self.limits.fps:g} frames a second."
            raise BadParameter("The frame rate is out of range.", field="fps", value=fps, remedy=remedy)


def _filters(chosen: Method) -> bool:
    return chosen.live_filter(chosen.Params(), (64, 64)) is not None


def _causal(chosen: Method) -> bool:
    """Whether the method has a stream; creating and discarding one takes a fraction of a millisecond."""
    return chosen.stream(chosen.Params(), (64, 64), 0, {}) is not None
