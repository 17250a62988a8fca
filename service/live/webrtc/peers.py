"""The WebRTC connections of this process, by id, and the answer to an offer."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine

from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.exceptions import InternalError, InvalidStateError, OperationError

from pipeline.errors import BadInput
from service.access.keys import Principal
from workers.ids import new_id

CONNECT_WITHIN_S = 20.0
"""Time within which a peer must connect, seconds; otherwise it is closed."""
_FAULTS = (
    ValueError, AssertionError, LookupError, AttributeError, TypeError,
    InternalError, InvalidStateError, OperationError,
)  # fmt: skip
"""Exceptions of aiortc for an invalid offer, or for one without a common codec."""


class Peer:
    """One connection: closed by its client, by the service, or when it is lost."""

    def __init__(self, owner: str) -> None:
        self.id = new_id("rtc_")
        self.owner = owner
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.closed = asyncio.Event()
        self.connection.on("connectionstatechange", self._changed)
        self._expiry = asyncio.get_running_loop().call_later(CONNECT_WITHIN_S, self._expire)

    async def answer(self, offer: str) -> str:
        """The SDP answer to an SDP offer, with all candidates (no trickle ICE). Raises BadInput."""
        try:
            if "m=video" not in offer:
                raise ValueError("it has no video stream")
            await self.connection.setRemoteDescription(RTCSessionDescription(offer, "offer"))
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

    def _expire(self) -> None:
        if self.connection.connectionState != "connected":
            self.closed.set()

    def _changed(self) -> None:
        if self.connection.connectionState in ("failed", "closed"):
            self.closed.set()


class Peers:
    """Peers by id. For one event loop only."""

    def __init__(self) -> None:
        self._peers: dict[str, Peer] = {}
        self._works: set[asyncio.Task[None]] = set()

    def open(self, owner: str) -> Peer:
        peer = Peer(owner)
        self._peers[peer.id] = peer
        self.run(self._forget(peer))
        return peer

    def find(self, peer_id: str, principal: Principal) -> Peer | None:
        """The caller's peer of that id."""
        found = self._peers.get(peer_id)
        return found if found is not None and found.owner == principal.owner else None

    async def _forget(self, peer: Peer) -> None:
        await peer.closed.wait()
        self._peers.pop(peer.id, None)
        await peer.close()

    def run(self, work: Coroutine[object, None, None]) -> None:
        """Run a task in the background until it is done."""
        task = asyncio.create_task(work)
        self._works.add(task)
        task.add_done_callback(self._works.discard)
