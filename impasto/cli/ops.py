"""`impasto ops`: state and control of a service, with an admin key."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import typer
from rich.table import Table

from impasto.cli.console import FAILED, emit, out, print_status, print_table, table
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of
from impasto.cli.records import audit, costs, retention
from workers.contract.request import Json

app = typer.Typer(no_args_is_help=True, help="Look at a service's queue, workers and failures; pause, drain, requeue.")

app.command()(audit)
app.command()(costs)
app.add_typer(retention, name="retention")

PlaceArgument = Annotated[
    str, typer.Argument(metavar="PLACE", help="A worker's id (dsp_...), a machine's name, or `queue` for all work.")
]


@app.command()
def status(server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """Show the queue, tasks by state, workers and machines."""
    with client_of(server, api_key) as client:
        found: Json = {
            "snapshot": client.ops.snapshot(),
            "queue": client.ops.queue(),
            "workers": client.ops.workers(),
            "nodes": client.ops.nodes(),
            "live": client.ops.live(),
        }
    if as_json:
        emit(found)
        return
    out.print(_queue_line(found), markup=False)
    print_table(_workers(found["workers"]))
    print_table(_nodes(found["nodes"]))


@app.command()
def check(
    blobs: Annotated[
        bool, typer.Option("--blobs", help="Read all stored assets, too, and compare their hashes.")
    ] = False,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Check the invariants of the service's database, and on request the stored bytes.

    The exit status is 0 if all of them hold, 1 if one is violated.
    """
    with client_of(server, api_key) as client:
        found = client.ops.check() + (client.ops.check_blobs() if blobs else [])
    if as_json:
        emit({"violations": found})
    for one in () if as_json else found:
        out.print(f"{one['kind']} {one['id']}: {one['message']} {one['remedy']}", markup=False)
    if found:
        raise typer.Exit(FAILED)
    print_status("No violation found.")


@app.command()
def failures(
    job: Annotated[str | None, typer.Option(help="Only failures of this job.")] = None,
    limit: Annotated[int, typer.Option(min=1, max=200, help="Maximum number of failures.")] = 20,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """List attempts that failed, newest first."""
    with client_of(server, api_key) as client:
        found = client.ops.failures(job, limit)
    if as_json:
        emit(found)
        return
    rows = table("attempt", "task", "job", "step", "when", "code")
    for one in found:
        code = (one["error"] or {}).get("code", one["outcome"])
        rows.add_row(one["attempt_id"], one["task_id"], one["job_id"], one["step"], _time(one["finished_at"]), code)
    print_table(rows)


@app.command()
def log(
    attempt: Annotated[str, typer.Argument(metavar="ATTEMPT", help="An attempt's id (att_...).")],
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Print the log of an attempt."""
    with client_of(server, api_key) as client:
        found = client.ops.log(attempt)
    emit(found) if as_json else out.print(found["log"], markup=False)


@app.command()
def drain(
    place: PlaceArgument,
    reason: Annotated[str, typer.Option(help="Reason, shown to other operators.")] = "",
    server: ServerOption = None,
    api_key: KeyOption = None,
) -> None:
    """Drain a place: no further task starts there, running tasks finish. With `queue`: no task starts anywhere."""
    with client_of(server, api_key) as client:
        client.ops.drain(place, reason)
    print_status(f"{place}: nothing new starts. `impasto ops resume {place}` ends that.")


@app.command()
def resume(place: PlaceArgument, server: ServerOption = None, api_key: KeyOption = None) -> None:
    """Resume a drained place."""
    with client_of(server, api_key) as client:
        client.ops.resume(place)
    print_status(f"{place}: work may start again.")


@app.command()
def requeue(
    task: Annotated[str, typer.Argument(metavar="TASK", help="A task's id (tsk_...).")],
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Run a failed or cancelled task again."""
    with client_of(server, api_key) as client:
        found = client.requeue(task)
    emit(found) if as_json else print_status(f"{task} is {found['state']}.")


def _queue_line(found: Json) -> str:
    jobs, tasks, queue = (found["snapshot"][name] for name in ("jobs", "tasks", "queue"))
    state = "PAUSED" if found["queue"]["paused"] else "open"
    return (
        f"queue {state}: {jobs['queued']} jobs queued, {jobs['running']} running; {queue['ready_tasks']} tasks ready, "
        f"{tasks['running']} running, {tasks['failed']} failed; {len(found['live'])} live sessions"
    )


def _workers(workers: list[Json]) -> Table:
    rows = table("worker", "host", "role", "state", "slots", "version", "since")
    for one in workers:
        slots = f"{len(one['at_work'])}/{len(one['slots'])}"
        row = (one["id"], one["host"], one["role"], one["state"], slots, one["version"], _time(one["started_at"]))
        rows.add_row(*row)
    return rows


def _nodes(nodes: list[Json]) -> Table:
    rows = table("machine", "state", "slots", "cpus", "gpus", "workers")
    for one in nodes:
        slots = f"{one['busy']}/{one['slots']}"
        rows.add_row(one["name"], one["state"], slots, f"{one['cpus']:g}", f"{one['gpus']:g}", str(len(one["workers"])))
    return rows


def _time(at: float) -> str:
    return datetime.fromtimestamp(at).astimezone().strftime("%Y-%m-%d %H:%M:%S")
