"""A Python client that openapi-python-client generates from the document works with a real service."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from service.app import openapi_document
from service.settings import Settings
from tests.conftest import ROOT
from tests.service.live import running
from workers.farm import open_farm

PACKAGE = "generated_impasto_client"
KEY = "a-long-secret-of-the-operator"


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of the generated package, which can be imported while the tests of this module run."""
    from openapi_python_client import Config, MetaType, generate  # half a second, which every process would spend
    from openapi_python_client.config import ConfigFile

    folder = tmp_path_factory.mktemp("client")
    (folder / "openapi.json").write_text(json.dumps(openapi_document()))
    config = Config.from_sources(
        ConfigFile.load_from_path(ROOT / "examples" / "openapi-python-client.yml"),
        MetaType.NONE,
        document_source=folder / "openapi.json",
        file_encoding="utf-8",
        overwrite=True,
        output_path=folder / PACKAGE,
    )
    errors = generate(config=config)
    assert [(error.header, error.detail) for error in errors] == []
    sys.path.insert(0, str(folder))
    yield folder / PACKAGE
    sys.path.remove(str(folder))


@contextmanager
def service(home: Path) -> Iterator[str]:
    settings = Settings(home=home, farm="local", workers=1, admin_key=KEY)
    farm = open_farm(settings)
    farm.start()
    with running(settings, farm) as url:
        yield url
    farm.stop()


def _module(name: str) -> Any:
    return importlib.import_module(f"{PACKAGE}.{name}")


def test_every_operation_is_generated(package: Path) -> None:
    names = {path.stem for path in package.glob("api/*/*.py")}
    operations = {row["operationId"] for item in openapi_document()["paths"].values() for row in item.values()}
    assert operations <= names


def test_upload_submit_list_and_events(package: Path, home: Path, tiny_clip: Path) -> None:
    models, types = _module("models"), _module("types")
    with service(home) as url, _client()(base_url=url, token=KEY, timeout=60) as client:
        with tiny_clip.open("rb") as file:
            upload = models.UploadBody(file=types.File(payload=file, file_name="clip.mp4", mime_type="video/mp4"))
            asset = _api("assets.upload").sync(client=client, body=upload)
        assert asset.info["frames"] == 24

        body = models.JobIn.from_dict({"method": "abstraction", "inputs": {"video": asset.id}})
        job = _api("jobs.submit").sync(client=client, body=body)
        assert job.request.method == "abstraction"

        events = [part for part in _api("events.get_events").sync(job.id, client=client).split("\n\n") if "id:" in part]
        assert '"succeeded"' in events[-1]

        jobs = _api("jobs.list_jobs").sync(client=client, state=models.RunState.SUCCEEDED)
        assert [found.id for found in jobs.items] == [job.id]
        assert _api("files.get_result").sync(job.id, client=client).payload.read()[4:8] == b"ftyp"


def test_a_refusal_is_a_typed_problem(package: Path, home: Path) -> None:
    models = _module("models")
    with service(home) as url, _client()(base_url=url, token=KEY) as client:
        body = models.JobIn.from_dict({"method": "no such method", "inputs": {}})
        problem = _api("jobs.submit").sync(client=client, body=body)
    assert isinstance(problem, models.Problem)
    assert problem.field == "method"


def _client() -> Any:
    return _module("client").AuthenticatedClient


def _api(name: str) -> ModuleType:
    return importlib.import_module(f"{PACKAGE}.api.{name}")
