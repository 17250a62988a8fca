"""An app on a farm that runs nothing by itself, and a client that connects like a program on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.settings import Settings
from tests.service.driven_farm import MAGIC, DrivenFarm
from tests.service.toy_method import Toy
from workers.farm import Farm

CLIP = MAGIC + b" of a cat"


@pytest.fixture
def only_toy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the toy method the only one, so that these tests do not depend on a real method."""
    found = {"toy": Toy()}
    monkeypatch.setattr("pipeline.methods.methods", lambda: found)
    monkeypatch.setattr("service.methods.routes.methods", lambda: found)


@pytest.fixture
def settings(home: Path) -> Settings:
    return Settings(home=home, heartbeat_s=0.2, idle_s=5.0)


@pytest.fixture
def farm(only_toy: None, home: Path) -> DrivenFarm:
    return DrivenFarm(home)


@pytest.fixture
def client(settings: Settings, farm: DrivenFarm) -> Iterator[TestClient]:
    yield from open_client(settings, farm)


def open_client(settings: Settings, farm: Farm, **more: Any) -> Iterator[TestClient]:
    app = create_app(settings, farm)
    with TestClient(app, "http://127.0.0.1:8420", raise_server_exceptions=False, **more) as client:
        yield client


@pytest.fixture
def asset(client: TestClient) -> str:
    return str(client.post("/v1/assets", files={"file": ("clip.mp4", CLIP)}).json()["id"])


@pytest.fixture
def body(asset: str) -> dict[str, Any]:
    """A valid job request."""
    return {"method": "toy", "inputs": {"video": asset}}


@pytest.fixture
def job(client: TestClient, body: dict[str, Any]) -> str:
    return str(client.post("/v1/jobs", json=body).json()["id"])
