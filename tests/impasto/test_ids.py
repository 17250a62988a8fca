"""Job ids in commands: a unique prefix is enough, and ids are never shortened in a pipe."""

from __future__ import annotations

import httpx
import pytest

from impasto.cli.console import print_table, table
from impasto.cli.jobs import find_id
from impasto_client import Client
from pipeline.errors import BadInput
from workers.errors import NotFound

JOBS = ("job_0a1b", "job_0a2c", "job_9f00")


def _answer(request: httpx.Request) -> httpx.Response:
    name = request.url.path.rpartition("/")[2]
    if name == "jobs":
        return httpx.Response(200, json={"items": [{"id": job} for job in JOBS], "cursor": None})
    if name in JOBS:
        return httpx.Response(200, json={"id": name})
    return httpx.Response(404, json={"code": "not-found", "detail": "Job not found.", "field": "job_id"})


@pytest.mark.parametrize(("text", "job"), [("job_0a1b", "job_0a1b"), ("0a2", "job_0a2c"), ("job_9", "job_9f00")])
def test_a_unique_beginning_of_an_id_is_accepted(text: str, job: str) -> None:
    with Client("http://service.test", transport=httpx.MockTransport(_answer)) as client:
        assert find_id(client, text) == job


def test_an_ambiguous_or_unknown_beginning_of_an_id_is_refused() -> None:
    with Client("http://service.test", transport=httpx.MockTransport(_answer)) as client:
        with pytest.raises(BadInput, match="2 jobs begin with that") as caught:
            find_id(client, "0a")
        assert "job_0a1b, job_0a2c" in caught.value.remedy
        with pytest.raises(NotFound):
            find_id(client, "7")


def test_ids_and_texts_are_not_cut_in_a_pipe(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    rows = table("id", "name")
    rows.add_row("job_" + "0123456789" * 4, "a long name " * 10)
    print_table(rows)
    line = capsys.readouterr().out.splitlines()[1]
    assert "job_" + "0123456789" * 4 in line and ("a long name " * 10).strip() in line
