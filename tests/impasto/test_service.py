"""The client and the command against the real service, a process of its own."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from impasto import Client
from impasto.cli.app import run
from impasto_client._sync.ops import Ops
from impasto_client.errors import JobFailed, NotAllowed
from pipeline.errors import BadParameter, UnreadableMedia
from pipeline.kernels.processors import usable_processors
from tests.conftest import TINY_FRAMES
from tests.ports import free_port
from tests.processes import started
from workers.errors import IdempotencyMismatch, NotFound
from workers.process.descriptors import MAX_DESCRIPTORS

Serve = Callable[..., str]


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """Starts `impasto serve` on a free port; returns its address. All are stopped at the end."""
    running: list[subprocess.Popen[str]] = []

    def start(*words: str, home: Path | None = None, **env: str) -> str:
        home = home or tmp_path_factory.mktemp("service")
        command = [sys.executable, "-m", "impasto", "serve", "--port", "0", "--home", str(home), *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | env)
        running.append(process)
        assert process.stdout is not None
        return process.stdout.readline().strip()

    yield start
    for process in running:
        process.terminate()
    assert [process.wait(timeout=30) for process in running] == [0] * len(running)


@pytest.fixture(scope="module")
def address(serve: Serve) -> str:
    return serve()


@pytest.fixture
def impasto(address: str) -> Iterator[Client]:
    with Client(address) as client:
        yield client


def test_a_job_from_upload_to_download(impasto: Client, tiny_clip: Path, tmp_path: Path) -> None:
    video = impasto.upload(tiny_clip)
    assert (video["kind"], video["info"]["frames"]) == ("video", TINY_FRAMES)
    job = impasto.submit("abstraction", {"video": video["id"]}, {"lines": "off"}, seed=3, name="tiny")
    states = [now["state"] for now in impasto.watch(job["id"])]
    assert states[-1] == "succeeded"
    done = impasto.wait(job["id"], timeout_s=60)
    assert {"result", "poster", "sheet"} <= set(done["results"])
    path = impasto.download(job["id"], tmp_path / "out.mp4")
    assert path.stat().st_size > 1000
    assert (impasto.download(job["id"], tmp_path / "sheet.jpg", "sheet")).read_bytes()[:2] == b"\xff\xd8"
    events = list(impasto.events(job["id"]))
    assert [e.seq for e in events if e.seq] == sorted({e.seq for e in events if e.seq})
    assert "job.state" in {e.type for e in events}
    impasto.delete(job["id"])
    with pytest.raises(NotFound):
        impasto.job(job["id"])


def test_a_large_file_is_uploaded_by_tus(impasto: Client, tiny_clip: Path, tmp_path: Path) -> None:
    large = tmp_path / "large.mp4"
    free_box = (9 << 20).to_bytes(4) + b"free" + bytes((9 << 20) - 8)  # MP4 allows padding at the end
    large.write_bytes(tiny_clip.read_bytes() + free_box)
    reports: list[int] = []
    asset = impasto.upload(large, lambda done, total: reports.append(done))
    assert asset["size_bytes"] == large.stat().st_size
    assert reports == [8 << 20, large.stat().st_size]
    assert impasto.upload(large) == asset


def test_problem_documents_become_the_typed_errors(impasto: Client, tiny_clip: Path, tmp_path: Path) -> None:
    video = impasto.upload(tiny_clip)["id"]
    with pytest.raises(BadParameter) as caught:
        impasto.submit("abstraction", {"video": video}, {"growing_limit": 1e9})
    assert (caught.value.field, caught.value.code) == ("params.growing_limit", "bad-parameter")
    (tmp_path / "fake.mp4").write_bytes(b"MZ not a video at all")
    with pytest.raises(UnreadableMedia):
        impasto.upload(tmp_path / "fake.mp4")


def test_a_repeated_idempotency_key_gives_the_same_job(impasto: Client, tiny_clip: Path) -> None:
    video = impasto.upload(tiny_clip)["id"]
    first = impasto.submit("abstraction", {"video": video}, idempotency_key="k1")
    assert impasto.submit("abstraction", {"video": video}, idempotency_key="k1")["id"] == first["id"]
    with pytest.raises(IdempotencyMismatch):
        impasto.submit("abstraction", {"video": video}, seed=1, idempotency_key="k1")
    impasto.cancel(first["id"])


def test_waiting_for_a_cancelled_job_fails_and_the_job_can_be_retried(impasto: Client, tiny_clip: Path) -> None:
    video = impasto.upload(tiny_clip)["id"]
    impasto.submit("abstraction", {"video": video}, seed=11)  # keeps the only worker busy
    job = impasto.submit("abstraction", {"video": video}, seed=12)
    assert impasto.cancel(job["id"])["state"] == "cancelled"
    with pytest.raises(JobFailed) as caught:
        impasto.wait(job["id"])
    assert caught.value.code == "cancelled"
    assert impasto.retry(job["id"])["state"] in ("queued", "running")
    assert impasto.wait(job["id"], timeout_s=60)["state"] == "succeeded"


def test_the_commands_use_the_service(
    address: str, tiny_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = ["--server", address]
    assert run(["submit", str(tiny_clip), "--format", "png", "--label", "shot=12", *at]) == 0
    job = capsys.readouterr().out.strip()
    assert run(["watch", job, "--json", *at]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["state"] == "succeeded"
    assert run(["get", job, "-o", f"{tmp_path}/frames/", *at]) == 0
    assert len(list((tmp_path / "frames").iterdir())) == TINY_FRAMES
    assert run(["get", job, "-o", f"{tmp_path}/poster.jpg", "--file", "poster", *at]) == 0
    assert run(["get", job, "-o", f"{tmp_path}/poster.png", "--file", "poster", *at]) == 2, "a JPEG image"
    assert run(["get", job, "-o", f"{tmp_path}/frames/", *at]) == 2
    assert "exists already" in capsys.readouterr().err
    assert run(["get", job, "-o", f"{tmp_path}/frames/", "--overwrite", *at]) == 0
    assert run(["get", job, "-o", f"{tmp_path}/a.mp4", *at]) == 2
    assert "does not fit the format png" in capsys.readouterr().err.lower()
    assert run(["jobs", "--json", "--state", "succeeded", *at]) == 0
    assert job in [each["id"] for each in json.loads(capsys.readouterr().out)]
    assert run(["jobs", *at]) == 0
    assert run(["retry", job, *at]) == 1
    assert run(["watch", "job_nothing", *at]) == 1


def test_keys_are_created_used_and_revoked(serve: Serve, home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["keys", "create", "alice", "--home", str(home), "--json"]) == 0
    key = json.loads(capsys.readouterr().out)
    address = serve("--auth", "required", home=home)
    with Client(address) as anonymous, pytest.raises(NotAllowed):
        anonymous.jobs()
    with Client(address, api_key=key["secret"]) as alice:
        assert alice.jobs() == []
        assert run(["keys", "revoke", key["id"], "--home", str(home)]) == 0
        assert run(["keys", "list", "--home", str(home), "--json"]) == 0
        assert json.loads(capsys.readouterr().out.splitlines()[-1])[0]["revoked_at"]
        with pytest.raises(NotAllowed):
            alice.jobs()


def test_the_error_names_a_bad_setting(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("IMPASTO_PORT", "many")
    assert run(["serve"]) == 2
    assert "IMPASTO_PORT" in capsys.readouterr().err


def test_operators_inspect_and_control_the_fleet(
    impasto: Client, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    at = ["--server", address]
    assert run(["ops", "status", "--json", *at]) == 0
    found = json.loads(capsys.readouterr().out)
    (worker,) = found["workers"]
    assert (worker["role"], worker["state"], len(worker["slots"])) == ("serve", "live", usable_processors())
    node = found["nodes"][0]["name"]
    for place in ("queue", worker["id"], node):
        assert run(["ops", "drain", place, "--reason", "a test", *at]) == 0
    assert impasto.ops.queue()["drain"]["reason"] == "a test"
    assert impasto.ops.workers()[0]["state"] == "drained" and impasto.ops.nodes()[0]["state"] == "drained"
    assert run(["ops", "status", *at]) == 0
    assert "queue PAUSED" in capsys.readouterr().out
    for place in ("queue", worker["id"], node):
        assert run(["ops", "resume", place, *at]) == 0
    assert not impasto.ops.queue()["paused"]
    assert impasto.ops.workers()[0]["state"] == "live" and impasto.ops.nodes()[0]["state"] == "open"
    assert run(["ops", "failures", *at]) == 0
    assert run(["ops", "drain", "nobody", *at]) == 1
    assert run(["ops", "log", "att_none", *at]) == 1
    assert run(["ops", "requeue", "tsk_none", *at]) == 1
    capsys.readouterr()


def test_a_worker_exports_its_metrics(tmp_path: Path, serve: Serve) -> None:
    home = tmp_path / "home"
    serve(home=home)
    port = str(free_port())
    command = [sys.executable, "-m", "impasto", "worker", "--home", str(home), "--metrics-port", port]
    with started(command, stdout=subprocess.PIPE, text=True) as worker:
        assert worker.stdout is not None
        assert worker.stdout.readline().startswith("dsp_")
        text = httpx.get(f"http://127.0.0.1:{port}/metrics").text
        worker.terminate()
        assert worker.wait(30) == 0
    assert f"impasto_workers {usable_processors()}.0" in text and 'impasto_ready{part="pool"} 1.0' in text


def test_a_worker_raises_its_open_file_limit(home: Path) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    program = (
        f"import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, (256, {hard}));"
        f"from impasto.cli.app import run; sys.exit(run(['worker', '--home', {str(home)!r}]))"
    )
    with started([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as worker:
        assert worker.stdout is not None and worker.stdout.readline().startswith("dsp_")
        limits = Path(f"/proc/{worker.pid}/limits").read_text()
    soft = next(line.split()[3] for line in limits.splitlines() if line.startswith("Max open files"))
    assert int(soft) == min(hard, MAX_DESCRIPTORS)


def test_the_database_check_has_an_exit_status(
    address: str, impasto: Client, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["ops", "check", "--server", address]) == 0
    broken = {"kind": "stuck-job", "id": "job_1", "message": "It is stuck.", "remedy": "Cancel it."}
    monkeypatch.setattr(Ops, "check", lambda ops: [broken])
    capsys.readouterr()
    assert run(["ops", "check", "--server", address]) == 1
    assert capsys.readouterr().out == "stuck-job job_1: It is stuck. Cancel it.\n"
    assert run(["ops", "check", "--server", address, "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == {"violations": [broken]}
