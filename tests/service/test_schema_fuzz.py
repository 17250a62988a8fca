"""schemathesis on our OpenAPI document and the real farm: no request gives a 5xx response."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, given, settings

from service.app import create_app
from service.settings import Settings
from workers.contract.request import JobRequest
from workers.farm import open_farm

if TYPE_CHECKING:  # imported where it is used: each process of a run imports this file, and one of them runs it
    from schemathesis import Case, GenerationMode

HEADERS = {"Host": "127.0.0.1"}
Known = dict[str, str]
BOUNDED = settings(
    max_examples=3, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
"""Number of examples of each operation and mode."""


@pytest.fixture(scope="module")
def schema(tmp_path_factory: pytest.TempPathFactory, tiny_clip: Path) -> Iterator[tuple[Any, Known]]:
    """A client of a farm with one asset and one job, and their ids, so that some responses are not 404."""
    import schemathesis

    for kind in ("application/offset+octet-stream", "application/zip"):
        schemathesis.serializer.alias(kind, "application/octet-stream")
    home = tmp_path_factory.mktemp("home")
    options = Settings(home=home, pool="none", requests_per_minute=10**6, max_json_bytes=8192, heartbeat_s=0.05)
    farm = open_farm(options)
    farm.start()
    asset = farm.assets.add(tiny_clip, "tiny.mp4")
    job = farm.jobs.cancel(farm.jobs.submit(JobRequest("abstraction", {"video": asset.id})).id)
    found = schemathesis.openapi.from_asgi("/openapi.json", create_app(options, farm), headers=HEADERS)
    project = farm.projects.create({"schema": 2, "name": "Swan"}, "")
    yield found, {"asset_id": asset.id, "job_id": job.id, "name": "abstraction", "project_id": project.id}
    farm.stop()


@pytest.mark.parametrize("name", ["positive", "negative"])
def test_no_generated_request_causes_a_5xx(schema: tuple[Any, Known], name: str) -> None:
    from schemathesis import GenerationMode

    mode = GenerationMode(name)
    api, known = schema
    operations = [found.ok() for found in api.get_all_operations()]
    assert len(operations) > 30
    for operation in sorted(operations, key=_order):
        if mode is GenerationMode.POSITIVE or _takes_something(operation):
            _bombard(operation, mode, {} if mode is GenerationMode.NEGATIVE else known)


def _order(operation: Any) -> int:
    """Sort key: events first, while the job is final and they end; deletions last."""
    return -1 if operation.path.endswith("/events") else int(operation.method == "delete")


def _takes_something(operation: Any) -> bool:
    """True if the operation has parameters or a body."""
    return bool({"parameters", "requestBody"} & set(operation.definition.raw))


def _bombard(operation: Any, mode: GenerationMode, known: Known) -> None:
    """Send the requests. `known`: existing values for path parameters."""
    from schemathesis.checks import not_a_server_error
    from schemathesis.specs.openapi.checks import content_type_conformance, response_schema_conformance

    checks = [not_a_server_error, response_schema_conformance, content_type_conformance]

    @given(case=operation.as_strategy(generation_mode=mode))
    @BOUNDED
    def send(case: Case) -> None:
        case.path_parameters.update({name: known[name] for name in case.path_parameters if name in known})
        case.call_and_validate(headers=HEADERS, checks=checks)

    send()
