"""A few hundred random requests and messages in every run of the suite; `make fuzz` makes many more."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from tests.fuzz import messages, parsers, requests, tus
from tests.fuzz.asgi import Reply
from tests.fuzz.ledger import Run
from tests.workers.live_toys import Echo


def _found(step: Callable[[Run, Path, int, int], Awaitable[None]], folder: Path, cases: int) -> Run:
    run = Run("test", "", "", seed=1, first=0)
    asyncio.run(step(run, folder / "step", 0, cases))  # type: ignore[arg-type]
    return run


def test_random_requests_cause_no_5xx(tmp_path: Path) -> None:
    run = _found(requests.step, tmp_path, 300)
    assert run.cases == 300 and run.findings == {} and run.outcomes["2xx"] > 50


def test_random_uploads_have_the_offsets_of_the_model(tmp_path: Path) -> None:
    run = _found(tus.step, tmp_path, 200)
    assert run.cases == 200 and run.findings == {} and run.outcomes["2xx"] > 50


def test_no_live_message_fails_the_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {**messages.methods(), "echo": Echo()}
    for place in ("pipeline.methods", "workers.live.sessions", "service.live.connection"):
        monkeypatch.setattr(f"{place}.methods", lambda: found)
    run = _found(messages.step, tmp_path, 20)
    assert run.cases > 20 and run.findings == {}


def test_an_answer_without_a_problem_document_is_a_finding() -> None:
    problem = {"content-type": "application/problem+json"}
    assert requests.verdict(Reply(500, problem, b"{}")) and requests.verdict(Reply(404, {}, b"gone"))
    assert not requests.verdict(Reply(404, problem, b"{}")) and not requests.verdict(Reply(200, {}, b"fine"))


def test_random_texts_are_read_or_refused(tmp_path: Path) -> None:
    run, found = Run("test", "", "", seed=1, first=0), list(parsers.parsers(tmp_path))
    assert {parsers.outcome(parser, parser.sample) for parser in found} == {"read"}
    parsers.step(run, found, 0, 20)
    assert run.findings == {} and run.outcomes["refused"] > 100
