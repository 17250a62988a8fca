"""Selects the next frame to paint: the newest. Pure: methods record what has happened and return what to do.

    arrive ──► waiting (one; with video codecs also the frames it is built on) ──► analyze ──► paint ──► unsent ──► sent
                  │ another arrives
                  ▼
               dropped

A frame may begin if no finished answer is still unsent and at most one other frame is in progress, whose `analyze` is
done. The analysis of a frame may overlap the painting of the frame before; there is no queue. While frames are painted
faster than they arrive, a frame begins only after the previous one is painted, because two at once would slow each
other down.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from workers.live.model import Packet

MAX_BUILT_ON = 60
"""Maximum number of dropped frames that are kept because a later one depends on them."""
MAX_BUILT_ON_BYTES = 8 << 20


@dataclass(frozen=True)
class StageStart:
    """Begin `packets[-1]`; the other packets are only decoded."""

    packets: tuple[Packet, ...]

    @property
    def frame(self) -> Packet:
        return self.packets[-1]


@dataclass
class FramePolicy:
    """
    Args:
        built_on: whether frames depend on earlier ones (a video codec), so that every frame must be decoded.
    """

    built_on: bool = False
    received: int = 0
    dropped: int = 0
    suspended: bool = False
    """No frame starts, because the session is about to change."""
    alone: bool = True
    """Whether frames are processed one at a time."""
    _waiting: list[Packet] = field(default_factory=list)
    _analyzing: Packet | None = None
    _painting: deque[Packet] = field(default_factory=deque)
    unsent: int = 0
    """Number of finished answers that have not been sent yet."""
    _keyframe_needed: bool = True
    _asked: bool = False

    @property
    def working(self) -> int:
        """Number of frames being analyzed or painted."""
        return len(self._painting) + (self._analyzing is not None)

    @property
    def pending(self) -> int:
        """Frames received and neither painted nor dropped."""
        return self.working + bool(self._waiting)

    @property
    def idle(self) -> bool:
        """Whether every received frame is answered or dropped."""
        return not self.pending and not self.unsent

    def arrive(self, packet: Packet) -> bool:
        """A frame has arrived. True: ask the client for a keyframe, because its frames cannot be decoded."""
        self.received += 1
        if not self.built_on or packet.key:
            self._drop_waiting()
            self._waiting, self._keyframe_needed, self._asked = [packet], False, False
            return False
        if self._keyframe_needed:
            self.dropped += 1
            return self._ask()
        self.dropped += bool(self._waiting)
        self._waiting.append(packet)
        return self._give_up() if self._overfull() else False

    def _overfull(self) -> bool:
        return len(self._waiting) > MAX_BUILT_ON or sum(len(p.data) for p in self._waiting) > MAX_BUILT_ON_BYTES

    def _give_up(self) -> bool:
        self._drop_waiting()
        self._keyframe_needed = True
        return self._ask()

    def _drop_waiting(self) -> None:
        self.dropped += bool(self._waiting)
        self._waiting = []

    def _ask(self) -> bool:
        """Whether to ask for a key frame: once, until one arrives."""
        asked, self._asked = self._asked, True
        return not asked

    def start(self) -> StageStart | None:
        """Begin the analysis of a frame and return it; None: no frame may begin now."""
        if (
            self.suspended
            or not self._waiting
            or self.unsent
            or self._analyzing
            or len(self._painting) > (not self.alone)
        ):
            return None
        begun = StageStart(tuple(self._waiting))
        self._waiting.clear()
        self._analyzing = begun.frame
        return begun

    def analyzed(self, begun: StageStart) -> None:
        """The analysis of a frame is done. No effect if the frame has been lost or finished since."""
        if self._analyzing is begun.frame:
            self._painting.append(begun.frame)
            self._analyzing = None

    def painted(self) -> None:
        """The oldest frame in work is finished; its answer waits to be sent."""
        if self._painting:
            self._painting.popleft()
        else:  # the message about its analysis arrives later
            self._analyzing = None
        self.unsent += 1

    def sent(self) -> None:
        """An answer has been sent."""
        self.unsent = max(0, self.unsent - 1)

    def lost(self) -> bool:
        """The worker died, and its frames are lost. True: ask the client for a key frame."""
        self.dropped += self.working
        self._analyzing = None
        self._painting.clear()
        return self.restart()

    def restart(self) -> bool:
        """Restart decoding. The waiting frame is kept only if it starts with a keyframe; True: ask for one."""
        if not self.built_on or (self._waiting and self._waiting[0].key):
            return False
        return self._give_up()

    def leave(self) -> None:
        """The client has disconnected: forget the waiting and the finished frames."""
        self._drop_waiting()
        self.dropped += self.unsent
        self.unsent = 0
        self._keyframe_needed, self._asked = True, False
