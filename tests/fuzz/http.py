"""The HTTP API over the real farm: requests of every operation, as the OpenAPI document allows and as it forbids."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import content_type_conformance, response_schema_conformance

from service.app import create_app
from service.settings import Settings
from tests.fuzz.ledger import Run
from tests.fuzz.samples import samples
from workers.contract.request import JobRequest
from workers.farm import open_farm

HEADERS = {"Host": "127.0.0.1"}
CHECKS = [not_a_server_error, response_schema_conformance, content_type_conformance]
EXAMPLES = 20
"""Number of requests of an operation and mode in a step."""
Known = dict[str, str]
"""Path parameter -> a value that exists."""


@contextmanager
def api(folder: Path) -> Iterator[tuple[Any, Known]]:
    """The schema of a service with one asset and one job, and their ids, so that some answers are not 404."""
    for kind in ("application/offset+octet-stream", "application/zip"):
        schemathesis.serializer.alias(kind, "application/octet-stream")
    options = Settings(
        home=folder / "home", pool="none", requests_per_minute=10**6, max_json_bytes=8192, heartbeat_s=0.05
    )
    clip = folder / "clip.mp4"
    clip.write_bytes(samples()["mp4"][0])
    farm = open_farm(options)
    farm.start()
    try:
        asset = farm.assets.add(clip, clip.name)
        job = farm.jobs.cancel(farm.jobs.submit(JobRequest("abstraction", {"video": asset.id})).id)
        project = farm.projects.create({"schema": 1, "name": "Swan"}, "")
        app = create_app(options, farm)
        known = {"asset_id": asset.id, "job_id": job.id, "name": "abstraction", "project_id": project.id}
        yield schemathesis.openapi.from_asgi("/openapi.json", app, headers=HEADERS), known
    finally:
        farm.stop()


def fuzz(run: Run, folder: Path, goes_on: Callable[[], bool]) -> None:
    """Run steps until the time is up. In each, a new service gets requests of every operation."""
    while goes_on():
        place = folder / str(run.first + run.steps)
        place.mkdir()
        with api(place) as (schema, known):
            for operation in sorted((found.ok() for found in schema.get_all_operations()), key=order):
                for mode in GenerationMode:
                    if goes_on():
                        _requests(run, operation, mode, known)
        run.steps += 1


def order(operation: Any) -> int:
    """Sort key of operations: event streams first, while the job is final and they end; deletions last."""
    return -1 if operation.path.endswith("/events") else int(operation.method == "delete")


def _requests(run: Run, operation: Any, mode: GenerationMode, known: Known) -> None:
    if mode is GenerationMode.NEGATIVE and not {"parameters", "requestBody"} & set(operation.definition.raw):
        return
    number = run.first + run.steps
    name = f"http:{operation.method} {operation.path}:{mode.value}:{run.seed}:{number}"

    @seed(run.seed * 1_000_003 + number)
    @settings(
        max_examples=EXAMPLES, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(case=operation.as_strategy(generation_mode=mode))
    def send(case: Any) -> None:
        if mode is GenerationMode.POSITIVE:
            case.path_parameters.update({key: known[key] for key in case.path_parameters if key in known})
        began = time.monotonic()
        response = case.call(headers=HEADERS)
        run.count(f"{response.status_code // 100}xx", time.monotonic() - began)
        case.validate_response(response, checks=CHECKS)

    try:
        send()
    except Exception as error:  # hypothesis raises the failure of any check, or groups of them
        run.findings[name] = f"{type(error).__name__}: {error}"[:500]
