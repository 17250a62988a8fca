"""Uniform errors, exit statuses and help of all commands."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest

from impasto.cli import app, console
from impasto.cli.console import Interrupted, status
from impasto_client.errors import JobFailed
from pipeline.errors import BadMedia, DeviceError, ImpastoError
from workers.errors import NotFound

COMMANDS = (
    *("render", "serve", "worker", "scene", "keys", "ops", "submit", "watch", "get"),
    *("cancel", "retry", "jobs", "methods", "doctor", "version"),
)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run([command, "--help"]) == 0
    assert "Usage: impasto" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["paint"], ["render"], ["render", "a", "-o", "b.mp4", "--seed", "-1"], ["--no"]])
def test_usage_errors_are_one_line_and_status_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(words) == 2
    output = capsys.readouterr().err
    assert output.startswith("error: ")
    assert len(output.splitlines()) == 1


def test_errors_with_json_output_are_objects(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["methods", "oil", "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert set(error) == {"code", "message", "field", "value", "remedy"}
    assert (error["field"], error["value"]) == ("method", "oil")


def _job_failed(code: str) -> JobFailed:
    error = JobFailed("It failed.")
    error.code = code
    return error


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (BadMedia("x"), 2),
        (_job_failed("unreadable-media"), 2),
        (_job_failed("internal-error"), 1),
        (DeviceError("x"), 1),
        (NotFound("x"), 1),
        (ImpastoError("x"), 1),
        (Interrupted("x"), 130),
    ],
)
def test_exceptions_map_to_exit_statuses(error: ImpastoError, code: int) -> None:
    assert status(error) == code


def test_the_log_of_a_failed_task_comes_before_the_error(capsys: pytest.CaptureFixture[str]) -> None:
    error = _job_failed("internal-error")
    error.log = "Traceback: the kernel panicked"
    assert console.fail(error, as_json=False) == 1
    assert capsys.readouterr().err.splitlines() == ["Traceback: the kernel panicked", "error: It failed."]


@pytest.mark.parametrize("command", ["jobs", "cancel job_1", "watch job_1", "get job_1 -o x.mp4"])
def test_without_a_service_the_error_explains_how_to_start_one(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run([*command.split(), "--server", "http://127.0.0.1:9"]) == 1
    assert "impasto serve" in capsys.readouterr().err


def _raising(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def refuse(text: str, form: str = "") -> object:
        raise error

    monkeypatch.setattr("impasto.delivery.target", refuse)


def test_operating_system_errors_are_printed_without_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _raising(monkeypatch, OSError(errno.ENOSPC, "No space left on device", "/tmp/x"))
    assert app.run(["render", "a.mp4", "-o", "b.mp4"]) == 1
    assert "No space left on device. (field: /tmp/x) Free some" in capsys.readouterr().err


def test_ctrl_c_gives_exit_status_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    _raising(monkeypatch, KeyboardInterrupt())
    assert app.run(["render", "a.mp4", "-o", "b.mp4", "--json"]) == 130
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "interrupted"


def test_doctor_checks_every_component(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = app.run(["doctor", "--json", "--home", str(home)])
    output = json.loads(capsys.readouterr().out)
    names = {check["name"] for check in output["checks"]}
    assert {"python", "numba", "opencl", "codec libx264", "face cascade", "methods", "disk", "memory"} <= names
    assert output["ok"] == (code == 0)
    assert code == 0, [check for check in output["checks"] if check["state"] == "broken"]


def test_doctor_exits_with_1_for_a_broken_component(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("impasto.cli.doctor.PACKAGES", ("no-such-package-of-ours",))
    assert app.run(["doctor", "--home", str(home)]) == 1
    assert "pip install no-such-package-of-ours" in capsys.readouterr().out


def test_the_version_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("impasto ")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["version", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["version"]
