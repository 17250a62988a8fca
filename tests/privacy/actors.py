"""A service that requires keys, and its callers: owners, an operator, and nobody."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient

from service.access.gate import COOKIE
from service.app import create_app
from service.settings import Settings
from workers.farm import Farm

ADMIN = "the admin key of this test, of some length"


@dataclass(frozen=True)
class Caller:
    """Sends requests with a key; "": without one. `at`: the address of a group. `session`: the key is in a cookie."""

    client: TestClient
    key: str = ""
    at: str = ""
    session: bool = False

    @property
    def headers(self) -> dict[str, str]:
        if self.session:
            return {"Cookie": f"{COOKIE}={self.key}", "Origin": str(self.client.base_url)}
        return {"Authorization": f"Bearer {self.key}"} if self.key else {}

    def __call__(self, verb: str, path: str, body: Any = None, **headers: str) -> Any:
        return self.client.request(verb, f"{self.at}{path}", json=body, headers=self.headers | headers)

    def upload(self, path: Path, name: str) -> str:
        """The id of a new asset."""
        files = {"file": (name, path.read_bytes())}
        made = self.client.post(f"{self.at}/v1/assets", files=files, headers=self.headers)
        return str(made.json()["id"])

    def project(self, document: Any) -> str:
        """The address of a new project."""
        made = self("POST", "/v1/projects", {"document": document}).json()
        return str(made["links"]["self"]).removeprefix(self.at)

    def share(self, project: str) -> str:
        """The address of a new link."""
        made = self("POST", f"{project}/share", {})
        assert made.status_code == 201, made.text
        return f"/v1/shared/{made.json()['token']}"


@contextmanager
def service(home: Path, farm: Farm, **changes: Any) -> Iterator[TestClient]:
    """A client without a key of a service that requires one."""
    given = {"pool": "none", "auth": "required", "admin_key": ADMIN, "requests_per_minute": 10**6, "heartbeat_s": 0.05}
    app = create_app(Settings(home=home, **(given | changes)), farm)
    with TestClient(app, "http://127.0.0.1:8420", raise_server_exceptions=False) as client:
        yield client


def one_shot(asset_id: str, method: str = "multistyle") -> dict[str, Any]:
    """A document that renders one asset."""
    return {
        "schema": 2, "name": "Film", "assets": {"v": {"id": asset_id}},
        "shots": [{"id": "s1", "video": "v", "layers": [{"id": "l1", "method": method}]}],
    }  # fmt: skip
