"""Made from `_async` by client/make_sync.py: do not edit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx

from impasto_client.errors import ServiceUnreachable
from impasto_client.network import NO_PROXIES, authorities, is_loopback, remedy_for
from impasto_client.problems import error_of


class Connection:
    """Sends requests to `{server}/v1`, and raises what the service answers as an error."""

    def __init__(
        self,
        server: str,
        api_key: str,
        timeout_s: float,
        transport: httpx.BaseTransport | None,
        ca_file: str | Path = "",
    ) -> None:
        headers = {"Authorization": f"Bearer {api_key}"} if api_key else {}
        timeout = httpx.Timeout(timeout_s)
        self.server = server.rstrip("/")
        self.http = httpx.Client(
            base_url=f"{self.server}/v1", headers=headers, timeout=timeout, transport=transport,
            verify=authorities(ca_file), mounts=NO_PROXIES if is_loopback(self.server) else None,
        )  # fmt: skip

    def json(self, verb: str, path: str, **more: Any) -> Any:
        """The JSON of the answer."""
        return (self.send(verb, path, **more)).json()

    def send(self, verb: str, path: str, **more: Any) -> httpx.Response:
        """The answer. Raises: ServiceUnreachable, the service's error."""
        try:
            response = self.http.request(verb, path, **more)
        except httpx.TransportError as error:
            raise ServiceUnreachable(
                f"No answer: {error or type(error).__name__}.",
                field="server",
                value=self.server,
                remedy=remedy_for(error),
            ) from error
        if response.is_error:
            raise error_of(response)
        return response

    def items(self, path: str, **query: object) -> list[Any]:
        """The items of one page."""
        found: list[Any] = (self.json("GET", path, params=given(**query)))["items"]
        return found

    def every(self, path: str, most: int | None = None, **query: Any) -> Iterator[Any]:
        """The items of all pages, at most `most`."""
        cursor, left = None, most
        while left is None or left > 0:
            limit = {} if left is None else {"limit": min(left, 200)}
            page = self.json("GET", path, params=given(cursor=cursor, **limit, **query))
            for item in page["items"]:
                yield item
            left = None if left is None else left - len(page["items"])
            cursor = page["cursor"]
            if cursor is None:
                return


def given(**query: Any) -> dict[str, Any]:
    """The parameters that are not None."""
    return {name: value for name, value in query.items() if value is not None}
