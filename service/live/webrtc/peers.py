"""The WebRTC connections of this process, by id, and the answer to an offer.

The service sends nothing to addresses that an offer names: its candidates are ignored, and the service answers peers
that reach it (as an ICE-lite agent does), with checks to the address that their own authenticated check came from.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.exceptions import InternalError, InvalidStateError, OperationError

from pipeline.errors import BadInput
from service.access.keys import Principal
from service.errors import Busy, retry_after
from workers.ids import new_id

CONNECT_WITHIN_S = 20.0
"""Time within which a peer must connect, and a sender's first frame must arrive, seconds; otherwise it is closed."""
MOST_WAITING = 4
"""Peers of an owner that may be waiting for that at once."""
MOST_PEERS = 32
"""Peers of an owner."""
_IGNORED = ("a=candidate:", "a=end-of-candidates", "a=remote-candidates:")
_FAULTS = (
    ValueError, AssertionError, LookupError, AttributeError, TypeError,
    InternalError, InvalidStateError, OperationError,
)  # fmt: skip
"""Exceptions of aiortc for an invalid offer, or for one without a common codec."""


class Peer:
    """One connection: closed by its client, by the service, or when it is lost."""

    def __init__(self, owner: str, sends: bool) -> None:
        self.waiting, self._sends = True, sends
        self.id = new_id("rtc_")
        self.owner = owner
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.closed = asyncio.Event()
        self.connection.on("connectionstatechange", self._changed)
        self._expiry = asyncio.get_running_loop().call_later(CONNECT_WITHIN_S, self._expire)

    async def answer(self, offer: str) -> str:
        """The SDP answer to an SDP offer, with all candidates (no trickle ICE). Raises BadInput."""
        try:
            await self.connection.setRemoteDescription(RTCSessionDescription(_bounded(offer), "offer"))
            await self.connection.setLocalDescription(await self.connection.createAnswer())
        except _FAULTS as error:
            await self.close()
            raise BadInput(
                f"The SDP offer cannot be answered: {error or type(error).__name__}.", field="body",
                remedy="Offer one video stream, H.264 or VP8, over ICE and DTLS.",
            ) from None  # fmt: skip
        return self.connection.localDescription.sdp

    async def close(self) -> None:
        """Close the connection. A second call has no effect."""
        self._expiry.cancel()
        self.closed.set()
        await self.connection.close()

    def in_use(self) -> None:
        """The peer no longer counts as one that waits."""
        self.waiting = False

    def _expire(self) -> None:
        if self.waiting:
            self.closed.set()

    def _changed(self) -> None:
        if self.connection.connectionState in ("failed", "closed"):
            self.closed.set()
        elif self.connection.connectionState == "connected" and not self._sends:
            self.in_use()


def _bounded(offer: str) -> str:
    """The offer without candidates. Raises ValueError unless it has one video stream, and one of sound at most."""
    lines = [line for line in offer.splitlines() if not line.startswith(_IGNORED)]
    kinds = sorted(line[2:].partition(" ")[0] for line in lines if line.startswith("m="))
    if kinds not in (["video"], ["audio", "video"]):
        raise ValueError("it has not one video stream, with or without sound")
    return "\r\n".join([*lines, ""])


class Peers:
    """Peers by id. For one event loop only."""

    def __init__(self) -> None:
        self._peers: dict[str, Peer] = {}
        self._works: set[asyncio.Task[None]] = set()

    def open(self, owner: str, sends: bool = False) -> Peer:
        """A new peer. Raises Busy if its owner has too many.

        Args:
            sends: whether it waits until its first frame has come (`Peer.in_use`), not only until it is connected.
        """
        own = [peer.waiting for peer in self._peers.values() if peer.owner == owner]
        if sum(own) >= MOST_WAITING or len(own) >= MOST_PEERS:
            raise Busy(
                "Too many WebRTC connections are open or waiting.", headers=retry_after(CONNECT_WITHIN_S),
                field="body", value=len(own), remedy="Close some, or wait until they are connected.",
            )  # fmt: skip
        peer = Peer(owner, sends)
        self._peers[peer.id] = peer
        self.run(self._forget(peer))
        return peer

    def find(self, peer_id: str, principal: Principal) -> Peer | None:
        """The caller's peer of that id."""
        found = self._peers.get(peer_id)
        return found if found is not None and found.owner == principal.owner else None

    async def close(self) -> None:
        """Close every peer."""
        await asyncio.gather(*(peer.close() for peer in tuple(self._peers.values())))

    async def _forget(self, peer: Peer) -> None:
        await peer.closed.wait()
        self._peers.pop(peer.id, None)
        await peer.close()

    def run(self, work: Coroutine[object, None, None]) -> None:
        """Run a task in the background until it is done."""
        task = asyncio.create_task(work)
        self._works.add(task)
        task.add_done_callback(self._works.discard)
