"""Contents of databases of earlier versions: the rows that each version wrote, in SQL that any database accepts."""

from __future__ import annotations

ASSET = "a" * 64
_OUTPUT = '{"format": "mp4", "quality": 20, "artefacts": []}'
_REQUEST = f"""{{"method": "toy", "inputs": {{"video": "ast_{ASSET}"}}, "params": {{}}, "seed": 3, "output": {_OUTPUT},
    "priority": 5, "name": "cat", "labels": {{}}, "webhook": ""}}"""


def _job(job_id: str, state: str, planned: str, doomed: str = "false") -> str:
    return f"""INSERT INTO jobs (id, owner, method, state, priority, request, params, step, step_count, planned,
        doomed, last_seq, digest, created_at, updated_at)
        VALUES ('{job_id}', 'anna', 'toy', '{state}', 5, '{_REQUEST}', '{{}}', 0, 2, {planned},
        {doomed}, 1, 'd', 1, 1)"""


def _step(job_id: str, step: int, ready: int, running: int) -> str:
    return f"""INSERT INTO steps (job_id, step, name, title, waiting, ready, running, succeeded, failed, cancelled,
        weight, weight_done, busy_s, stages)
        VALUES ('{job_id}', {step}, 's{step}', 'S', 0, {ready}, {running}, 0, 0, 0, 2, 0, 0, '{{}}')"""


def _task(task_id: str, position: int, state: str, attempt: str = "NULL") -> str:
    return f"""INSERT INTO tasks (id, job_id, step, position, key, args, weight, chained, state, blockers, failures,
        interruptions, ready_at, progress, attempt_id)
        VALUES ('{task_id}', 'job_1', 0, {position}, '{task_id}', '{{}}', 1, false, '{state}', 0, 0, 0, 0, 0,
        {attempt})"""


_ROWS = (
    f"""INSERT INTO assets (id, sha256, size_bytes, filename, media_type, kind, info, created_at, owner)
        VALUES ('ast_{ASSET}', '{ASSET}', 10, 'cat.mp4', 'video/mp4', 'video', '{{"width": 64}}', 1.5, 'anna')""",
    f"""INSERT INTO asset_owners (owner, asset_id, filename, created_at)
        VALUES ('anna', 'ast_{ASSET}', 'cat.mp4', 1.5)""",
    _job("job_1", "running", "true"),
    _job("job_2", "queued", "false"),
    _job("job_3", "paused", "true"),
    *(_step(job, step, *counts) for job in ("job_1", "job_3") for step, counts in ((0, (1, 1)), (1, (0, 0)))),
    *(_step("job_2", step, 0, 0) for step in (0, 1)),
    _task("tsk_1", 1, "running", "'att_1'"),
    _task("tsk_2", 2, "ready"),
    """INSERT INTO events (job_id, seq, at, type, data) VALUES ('job_1', 1, 1, 'job.state', '{"state": "queued"}')""",
)

_LEASED_ATTEMPTS = (
    """INSERT INTO attempts (id, task_id, job_id, number, dispatcher, worker, outcome, started_at, lease_until, log)
        VALUES ('att_1', 'tsk_1', 'job_1', 1, 'dsp_old@host', 'w', 'running', 1, 30, '')""",
)
_LEASED_DISPATCHERS = (
    """INSERT INTO attempts (id, task_id, job_id, number, dispatcher, worker, outcome, started_at, log)
        VALUES ('att_1', 'tsk_1', 'job_1', 1, 'dsp_old@host', 'w', 'running', 1, '')""",
    "INSERT INTO dispatchers (id, started_at, lease_until) VALUES ('dsp_old@host', 1, 30)",
    "UPDATE jobs SET ready = 1 WHERE id = 'job_1'",
)
"""Since revision 0003 the leases of dispatchers are in a separate table."""

RELEASED = {
    "0001": _ROWS + _LEASED_ATTEMPTS,
    "0002": _ROWS + _LEASED_ATTEMPTS,
    "0003": _ROWS + _LEASED_DISPATCHERS,
}
"""By the revision of their database: a job at work (one task runs, one is ready), one to be planned, one paused. These
were in a version that somebody may have; each is tested for ever."""
