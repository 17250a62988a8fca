"""A WHIP server for tests (aiortc, on a thread of its own): accepts one sender and keeps what it receives."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import av
import uvicorn
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError, MediaStreamTrack
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from service.server import address_of


@dataclass
class WhipServer:
    """Frames that were received, and the state of the connection."""

    address: str = ""
    frames: list[av.VideoFrame] = field(default_factory=list)
    deleted: bool = False
    _peers: list[RTCPeerConnection] = field(default_factory=list)

    async def publish(self, request: Request) -> Response:
        peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._peers.append(peer)
        peer.on("track", lambda track: asyncio.ensure_future(self._take(track)))
        await peer.setRemoteDescription(RTCSessionDescription((await request.body()).decode(), "offer"))
        await peer.setLocalDescription(await peer.createAnswer())
        return Response(peer.localDescription.sdp, 201, {"Location": "/resource"}, "application/sdp")

    async def delete(self, _request: Request) -> Response:
        self.deleted = True
        for peer in self._peers:
            await peer.close()
        return Response()

    async def _take(self, track: MediaStreamTrack) -> None:
        try:
            while True:
                frame = await track.recv()
                if isinstance(frame, av.VideoFrame):
                    self.frames.append(frame)
        except MediaStreamError:
            return


@contextmanager
def whip_server() -> Iterator[WhipServer]:
    found = WhipServer()
    routes = [Route("/whip", found.publish, methods=["POST"]), Route("/resource", found.delete, methods=["DELETE"])]
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = uvicorn.Server(uvicorn.Config(Starlette(routes=routes), log_level="warning"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        found.address = address_of(listener).replace("http", "whip", 1) + "/whip"
        try:
            yield found
        finally:
            server.should_exit = True
            thread.join(10)
