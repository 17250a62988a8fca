"""`impasto ops audit`, `costs` and `retention`: who did what, what it has cost, and when it is deleted."""

from __future__ import annotations

import csv
import sys
from datetime import UTC, datetime
from typing import Annotated

import typer

from impasto.cli.console import emit, out, print_status, print_table, table
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of
from pipeline.errors import BadParameter
from workers.contract.request import Json

retention = typer.Typer(no_args_is_help=True, help="Delete jobs with their results by age: rules, dry runs.")


def audit(
    who: Annotated[str | None, typer.Option(help="Only what this user did, or was done for this owner.")] = None,
    action: Annotated[str | None, typer.Option(help="Only this operation, as create_key.")] = None,
    about: Annotated[str | None, typer.Option(help="Only what was done to the object with this id.")] = None,
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="Maximum number of entries.")] = 50,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """List who changed what, newest first."""
    with client_of(server, api_key) as client:
        found = client.owners.audit(who, action, about, limit)
    if as_json:
        emit(found)
        return
    rows = table("when", "user", "for", "action", "object", "address")
    for one in found:
        at = datetime.fromtimestamp(one["at"]).astimezone().strftime("%Y-%m-%d %H:%M:%S")
        rows.add_row(at, one["user"], one["owner"], one["action"], one["object"], one["address"])
    print_table(rows)


def costs(
    by: Annotated[str, typer.Option(help="owner, or the name of a label.")] = "owner",
    since: Annotated[str | None, typer.Option(help="First day of the period, UTC: 2026-01-31.")] = None,
    until: Annotated[str | None, typer.Option(help="Day after the last one.")] = None,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print comma-separated values.")] = False,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Sum what jobs have cost, by owner or label: CPU seconds, slot seconds, bytes of results."""
    first, end = _day("--since", since) or 0.0, _day("--until", until)
    if end is not None and end <= first:
        raise BadParameter("The period has no day.", field="--until", value=until, remedy="End later.")
    with client_of(server, api_key) as client:
        found = client.owners.costs(by, first, end)
    if as_json:
        emit(found)
    elif as_csv:
        writer = csv.DictWriter(sys.stdout, ["name", "jobs", "cpu_s", "busy_s", "bytes"])
        writer.writeheader()
        writer.writerows(found)
    else:
        rows = table(by, "jobs", "CPU s", "slot s", "MB")
        for one in found:
            size = f"{one['bytes'] / 1e6:.1f}"
            rows.add_row(one["name"], str(one["jobs"]), f"{one['cpu_s']:.0f}", f"{one['busy_s']:.0f}", size)
        print_table(rows)


def _day(option: str, text: str | None) -> float | None:
    try:
        return None if text is None else datetime.strptime(text, "%Y-%m-%d").replace(tzinfo=UTC).timestamp()
    except ValueError:
        raise BadParameter("A day is written as 2026-01-31.", field=option, value=text) from None


@retention.command("list")
def list_rules(server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """List the rules, and how many jobs each deletes at the next sweep."""
    with client_of(server, api_key) as client:
        found = client.owners.rules()
    if as_json:
        emit(found)
        return
    rows = table("rule", "jobs that ended", "due now")
    for one in found:
        rows.add_row(one["rule"]["id"], _words(one["rule"]), str(one["due"]["jobs"]))
    print_table(rows)


@retention.command()
def add(
    days: Annotated[float, typer.Argument(min=0, help="Age in days, since the job ended.")],
    owner: Annotated[str | None, typer.Option(help="Only jobs of this user or group.")] = None,
    label: Annotated[str | None, typer.Option(help="Only jobs with this label: name, or name:value.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say which jobs it would delete now.")] = False,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Delete jobs with their results once they have this age."""
    name, colon, value = (label or "").partition(":")
    with client_of(server, api_key) as client:
        found = client.owners.add_rule(days, owner, name or None, value if colon else None, dry_run)
    if as_json:
        emit(found)
        return
    for job_id in found["due"]["first"] if dry_run else ():
        out.print(job_id, markup=False)
    what = "Would delete" if dry_run else f"{found['rule']['id']} deletes"
    print_status(f"{what} {found['due']['jobs']} jobs that ended {_words(found['rule'])}.")


@retention.command()
def remove(
    rule: Annotated[str, typer.Argument(metavar="RULE", help="A rule's id (rul_...).")],
    server: ServerOption = None,
    api_key: KeyOption = None,
) -> None:
    """Delete a rule."""
    with client_of(server, api_key) as client:
        client.owners.remove_rule(rule)
    print_status(f"{rule} is deleted.")


@retention.command()
def apply(server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """Delete now what the rules fit, and print the ids of the deleted jobs."""
    with client_of(server, api_key) as client:
        gone = client.owners.apply_rules()
    if as_json:
        emit(gone)
        return
    for job_id in gone:
        out.print(job_id, markup=False)
    print_status(f"{len(gone)} jobs are deleted.")


def _words(rule: Json) -> str:
    parts = [f"more than {rule['days']:g} days ago"]
    parts += [f"of {rule['owner']}"] * bool(rule["owner"])
    if rule["label"]:
        parts.append(f"with the label {rule['label']}" + ("" if rule["value"] is None else f":{rule['value']}"))
    return ", ".join(parts)
