"""`impasto owners`: users and groups of a service, their quotas and members. Mostly with an admin key."""

from __future__ import annotations

from typing import Annotated

import typer

from impasto.cli.console import emit, print_status, print_table, table
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of
from pipeline.errors import BadParameter

app = typer.Typer(no_args_is_help=True, help="List and change users and groups of a service: quotas, members.")

OwnerArgument = Annotated[str, typer.Argument(metavar="OWNER", help="Id of a user (usr_...) or group (grp_...).")]
GroupArgument = Annotated[str, typer.Argument(metavar="GROUP", help="A group's id (grp_...).")]
QuotaOption = Annotated[
    list[str] | None, typer.Option("--quota", help="name=limit, as active_jobs=50; name=default. Several are possible.")
]


@app.command("list")
def list_(server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False) -> None:
    """List users and groups with the quotas of their own."""
    with client_of(server, api_key) as client:
        found = client.owners.all()
    if as_json:
        emit(found)
        return
    rows = table("id", "kind", "name", "quotas", "state")
    for one in found:
        quotas = ", ".join(f"{name} {limit}" for name, limit in sorted(one["quotas"].items()))
        rows.add_row(one["id"], one["kind"], one["name"], quotas, "disabled" if one["disabled_at"] else "")
    print_table(rows)


@app.command("add-group")
def add_group(
    name: Annotated[str, typer.Argument(help="Name of the group.")],
    quota: QuotaOption = None,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Create a group. Users are created with their first key, or when they sign in."""
    quotas = {key: limit for key, limit in _quotas(quota).items() if limit is not None}
    with client_of(server, api_key) as client:
        made = client.owners.create("group", name, quotas)
    emit(made) if as_json else print_status(f"{made['id']}: `impasto owners member {made['id']} USER --role owner`.")


@app.command()
def change(
    owner: OwnerArgument,
    quota: QuotaOption = None,
    name: Annotated[str | None, typer.Option(help="Another name.")] = None,
    disable: Annotated[
        bool | None, typer.Option("--disable/--enable", help="Refuse all keys of a user, or a group's members.")
    ] = None,
    subject: Annotated[
        str | None, typer.Option(help='Who signs in as this user: "ISSUER SUBJECT" of the OpenID provider.')
    ] = None,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Change quotas or the name of a user or group, or disable it."""
    given = {"name": name, "disabled": disable, "subject": subject, "quotas": _quotas(quota) or None}
    changes = {key: value for key, value in given.items() if value is not None}
    if not changes:
        raise BadParameter(
            "Nothing is to change.", field="--quota", remedy="Give --quota, --name, --disable or --subject."
        )
    with client_of(server, api_key) as client:
        found = client.owners.change(owner, **changes)
    emit(found) if as_json else print_status(f"{owner}: {', '.join(changes)} changed.")


@app.command()
def members(
    group: GroupArgument, server: ServerOption = None, api_key: KeyOption = None, as_json: JsonFlag = False
) -> None:
    """List the members of a group. Its members may do this with their own keys."""
    with client_of(server, api_key) as client:
        found = client.owners.members(group)
    if as_json:
        emit(found)
        return
    rows = table("user", "name", "role")
    for one in found:
        rows.add_row(one["user"], one["name"], one["role"])
    print_table(rows)


@app.command()
def member(
    group: GroupArgument,
    user: Annotated[str, typer.Argument(metavar="USER", help="A user's id (usr_...).")],
    role: Annotated[str | None, typer.Option(help="owner, editor or viewer.")] = None,
    remove: Annotated[bool, typer.Option("--remove", help="Remove the user from the group.")] = False,
    server: ServerOption = None,
    api_key: KeyOption = None,
) -> None:
    """Add a user to a group, change the role, or remove the user. Owners of the group may do this with their own
    keys."""
    if remove == (role is not None):
        raise BadParameter("Give either --role or --remove.", field="--role", value=role)
    with client_of(server, api_key) as client:
        if role is None:
            client.owners.remove_member(group, user)
        else:
            client.owners.put_member(group, user, role)
    print_status(f"{user} is {'no member' if role is None else role} of {group}.")


@app.command()
def transfer(
    source: OwnerArgument,
    target: Annotated[str, typer.Argument(metavar="TARGET", help="The new owner of everything.")],
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Move all jobs, projects and assets of a user or group to another."""
    with client_of(server, api_key) as client:
        moved = client.owners.transfer(source, target)
    emit(moved) if as_json else print_status(", ".join(f"{count} {name}" for name, count in moved.items()) + " moved.")


def _quotas(given: list[str] | None) -> dict[str, int | None]:
    """Name -> limit; None: the service's limit again."""
    found: dict[str, int | None] = {}
    for text in given or ():
        name, _, limit = text.partition("=")
        if not limit.isdecimal() and limit != "default":
            raise BadParameter("A quota is name=limit.", field="--quota", value=text, remedy="As active_jobs=50.")
        if name in found:
            raise BadParameter(f"{name!r} is given twice.", field="--quota", value=text, remedy="Give it once.")
        found[name] = None if limit == "default" else int(limit)
    return found
