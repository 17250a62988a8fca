"""Log lines of an attempt name its job, task and attempt, as JSON that user input cannot forge."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from workers.process.log_context import current_context, log_extra, set_context, working_for
from workers.process.logs import OURS, attempt_facts, captured, set_up_logs, shortened
from workers.settings import FarmSettings

LOG = logging.getLogger("workers.test")


@pytest.fixture
def lines(capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., list[str]]]:
    """The lines logged during the test; the logging configuration is restored at its end."""
    levels = {name: logging.getLogger(name).level for name in OURS}

    yield lambda: capsys.readouterr().err.splitlines()
    root = logging.getLogger()
    for handler in [h for h in root.handlers if h.get_name() == "impasto"]:
        root.removeHandler(handler)
    for name, level in levels.items():
        logging.getLogger(name).setLevel(level)


def rows(logged: list[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in logged]


def test_a_log_line_of_an_attempt_names_job_task_and_attempt(lines: Callable[[], list[str]]) -> None:
    set_up_logs(FarmSettings(log_format="json", log_level="info"))
    with captured("job_1", "tsk_2", "att_3"):
        LOG.info("painting %d", 7)
        helper = threading.Thread(
            target=lambda: (set_context(attempt_facts("job_1", "tsk_2", "att_3")), LOG.info("helped"))
        )
        helper.start()
        helper.join()
    LOG.info("outside")
    inside, helped, outside = rows(lines())
    assert inside["message"] == "painting 7" and helped["message"] == "helped"
    for row in (inside, helped):
        assert (row["job"], row["task"], row["attempt"]) == ("job_1", "tsk_2", "att_3")
    assert "job" not in outside
    assert {"time", "level", "logger", "message"} <= outside.keys()


def test_facts_of_a_line_override_those_of_its_context(lines: Callable[[], list[str]]) -> None:
    set_up_logs(FarmSettings(log_format="json", log_level="info"))
    with working_for({"request": "r1", "job": "job_a"}):
        LOG.info("x", extra=log_extra(job="job_b", seconds=0.5))
    (row,) = rows(lines())
    assert (row["request"], row["job"], row["seconds"]) == ("r1", "job_b", 0.5)
    assert current_context() == {}


@pytest.mark.parametrize("kind", ["json", "text"])
def test_newlines_in_a_message_cannot_forge_a_log_line(lines: Callable[[], list[str]], kind: str) -> None:
    set_up_logs(FarmSettings.model_validate({"log_format": kind, "log_level": "info"}))
    LOG.info("the name is %s", 'a"}\n{"level": "error", "message": "forged"}')
    logged = lines()
    assert len(logged) == 1
    assert kind == "text" or json.loads(logged[0])["level"] == "info"


def test_a_traceback_is_logged_in_one_line(lines: Callable[[], list[str]]) -> None:
    set_up_logs(FarmSettings(log_format="json"))
    try:
        raise ValueError("no such colour")
    except ValueError:
        LOG.exception("it failed", extra=log_extra(job="job_9"))
    (row,) = rows(lines())
    assert "no such colour" in row["trace"] and row["job"] == "job_9" and row["level"] == "error"


def test_a_long_record_keeps_its_first_line_and_its_cause() -> None:
    trace = "task failed\n" + "  File x.py\n" * 3000 + "NoBlob: assets/15"
    kept = shortened(trace)
    assert kept.startswith("task failed\n") and kept.endswith("NoBlob: assets/15")
    assert len(kept) < 8_100 and f"[{len(trace) - 8_000} characters left out]" in kept
    assert shortened("short") == "short"


def test_logging_can_be_configured_again_with_another_level(lines: Callable[[], list[str]]) -> None:
    set_up_logs(FarmSettings(log_format="text", log_level="warning"))
    LOG.info("quiet")
    set_up_logs(FarmSettings(log_format="text", log_level="info"))
    LOG.info("loud", extra=log_extra(job="job_1"))
    (line,) = lines()
    assert line.endswith("INFO workers.test: loud [job=job_1]")


def test_workers_receive_no_secret() -> None:
    settings = FarmSettings(database_url="postgresql://a:secret@b/c", log_format="json")
    for_workers = settings.for_workers
    assert (for_workers.database_url, for_workers.log_format) == ("", "json")
