"""The privacy matrix: every operation x its objects x every caller gives what the rules say, and nothing of Anna's data
reaches anybody else. New operations are in it by themselves; see tests/privacy/matrix.py."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.routing import WebSocketRoute
from starlette.testclient import WebSocketDenialResponse

from service.context.depends import Context, Reader
from service.live.sessions import LiveSession
from tests.privacy.actors import service
from tests.privacy.matrix import (
    BECOMES_AN_INPUT,
    LINK,
    MEMBERS,
    OPERATORS,
    PART_IDS,
    Operation,
    Undescribed,
    operations,
)
from tests.privacy.world import ANNA, BEN, SECRET, Actor, World
from tests.service.driven_farm import DrivenFarm
from tests.service.toy_method import Toy
from workers.contract.owners import Role
from workers.contract.record import ANY_OWNER, Asset
from workers.farm_parts.assets import FarmAssets
from workers.ids import new_id
from workers.store.owners import Owners

TUS = {"Tus-Resumable": "1.0.0", "Upload-Length": "8", "Upload-Offset": "0", "If-Match": "*"}


@pytest.fixture
def client(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    found = {"toy": Toy()}
    monkeypatch.setattr("pipeline.methods.methods", lambda: found)
    for module in ("service.methods.routes", "workers.projects.checking", "workers.projects.submissions",
                   "workers.projects.sources"):  # fmt: skip
        monkeypatch.setattr(f"{module}.methods", lambda: found)
    farm = DrivenFarm(home)
    with service(home, farm, webhook_poll_s=3600.0) as client:
        yield client
    farm.stop()


@pytest.fixture
def world(client: TestClient, home: Path, tmp_path: Path) -> World:
    return World(client, client.app.state.service.farm, home, tmp_path)  # type: ignore[attr-defined]


@pytest.fixture
def shared_world(client: TestClient, home: Path, tmp_path: Path) -> World:
    """Anna's objects belong to her group."""
    return World(client, client.app.state.service.farm, home, tmp_path, shared=True)  # type: ignore[attr-defined]


Variant = tuple[str, Mapping[str, str], dict[str, str]]
"""Name, ids, and the owner of each kind of object."""


def _variants(operation: Operation, world: World) -> Iterator[Variant]:
    annas = dict.fromkeys(("asset", "job", "task", "project", "upload", "peer", "group"), ANNA)
    if LINK in operation.params:
        yield "in the project", {**world.ids, "job": world.ids["film"]}, annas
        if operation.owned:
            yield "outside the project", {**world.outside, "link": world.ids["link"]}, annas
        yield "named by Ben's project", world.thief, annas
    else:
        yield "Anna's", world.ids, annas
        if "project" in operation.owned:
            yield "named by Ben's project", world.thief, {**annas, "project": BEN}


def _expected(operation: Operation, actor: Actor, variant: Variant) -> set[int] | None:
    """Allowed statuses; None: any that grants access."""
    name, _, owners = variant
    if LINK in operation.params:
        if not actor.link_lives and name != "named by Ben's project":
            return {410}
        named = bool(operation.owned)
        return None if name == "in the project" or not named else {404}
    if not operation.keyed:
        return None
    if actor.scopes is None:
        return {401}
    if actor.stranger:
        return {404}
    if actor.caller.session and operation.path.startswith("/v1/keys"):
        return None  # users who have signed in manage their own keys
    if not actor.may(operation.scopes):
        return {403}
    belongs = actor.owner == ANNA or actor.member
    if operation.path == MEMBERS and belongs and not actor.chooses:
        return {403}
    if operation.owned == ["group"] and belongs:
        return None
    if "admin" in actor.scopes and operation.owned != ["peer"] and operation.schema not in BECOMES_AN_INPUT:
        return None
    return None if {owners[kind] for kind in operation.owned} <= {actor.owner} else {404}


def _granted(operation: Operation, status: int) -> bool:
    """Whether the answer shows that the caller may: it failed at most by the object's state or the body."""
    missing = {404, 410} if operation.owned or LINK in operation.params else set()
    if "peer" in operation.owned or OPERATORS & set(operation.params):
        missing = set()  # these tests have none
    return status < 500 and status not in {401, 403, *missing}


def _may_know(operation: Operation, actor: Actor, variant: Variant) -> bool:
    """Whether Anna's data may be in the answer."""
    if LINK in operation.params:
        return actor.link_lives and variant[0] == "in the project"
    if actor.member and (operation.owned == ["group"] or operation.path == "/v1/me"):
        return True
    named = variant[0] == "named by Ben's project"
    return not named and actor.scopes is not None and (actor.owner == ANNA or "admin" in actor.scopes)


def _token_of(actor: Actor, operation: Operation, variant: Variant) -> Mapping[str, str]:
    """The ids with the actor's own token; who has none tries one without a signature."""
    _, ids, _ = variant
    if LINK not in operation.params or variant[0] == "named by Ben's project":
        return ids
    return {**ids, "link": actor.link or "x.y"}


def _cells(world: World, client: TestClient) -> Iterator[tuple[Operation, str, Actor, Variant]]:
    """Refused callers first and deletions last, so that objects exist while they are asked for."""
    found = operations(client.app)  # type: ignore[arg-type]
    assert all(operation.owned is not None for operation in found), "each is described"
    for operation in sorted(found, key=_order):
        for variant in _variants(operation, world):
            for name in sorted(world.actors, key=lambda name: world.actors[name].chooses or name == "editor"):
                yield operation, name, world.actors[name], variant


def _order(operation: Operation) -> tuple[bool, bool, int]:
    return operation.verb == "DELETE", operation.verb not in ("GET", "HEAD"), -len(operation.path)


def _fault(world: World, operation: Operation, actor: Actor, variant: Variant) -> str:
    """What is wrong with a cell, or an empty text."""
    expected = _expected(operation, actor, variant)
    if expected is None and operation.verb == "DELETE" and variant[0] == "Anna's":
        variant = (variant[0], world.fresh(), variant[2])
    elif expected is None and operation.verb == "DELETE" and PART_IDS.keys() & set(operation.params):
        variant = (variant[0], world.fresh_part(variant[1]), variant[2])
    ids = _token_of(actor, operation, variant)
    content: dict[str, Any] = operation.content(ids)
    headers = {**TUS, **actor.caller.headers, **content.pop("headers", {})}
    answer = actor.caller.client.request(
        operation.verb, actor.caller.at + operation.url(ids), headers=headers, **content
    )
    wrong = answer.status_code not in expected if expected else not _granted(operation, answer.status_code)
    if wrong:
        return f"{answer.status_code} instead of {expected or 'access'}: {answer.text[:200]}"
    if _may_know(operation, actor, variant):
        return ""
    told = f"{answer.headers}".encode() + answer.content
    hidden = [SECRET, *([] if operation.owned or LINK in operation.params or actor.stranger else _ids_to_hide(world))]
    leaks = [text for text in hidden if text.encode() in told]
    return f"{answer.status_code} with {leaks}" if leaks else ""


def _ids_to_hide(world: World) -> list[str]:
    """Ids of Anna's that a list must not show others. (Ben's document names her asset.)"""
    return [world.owner_id, *(world.ids[kind] for kind in ("job", "task", "project", "upload"))]


def _faults(world: World, client: TestClient, only: str = "") -> tuple[int, list[str]]:
    """Number of cells, and a line for each that is wrong."""
    count, found = 0, []
    for operation, name, actor, variant in _cells(world, client):
        if only not in operation.path:
            continue
        count += 1
        if fault := _fault(world, operation, actor, variant):
            found.append(f"{operation.verb} {operation.path}, {variant[0]}, {name}: {fault}")
    return count, found


def test_every_cell_of_the_privacy_matrix(world: World, client: TestClient, record_property: Any) -> None:
    count, found = _faults(world, client)
    record_property("cells", count)
    print(f"{count} cells")
    assert not found, "\n".join(found)
    assert count > 1200, "operations have vanished from the matrix"


def test_every_cell_of_the_privacy_matrix_of_a_group(shared_world: World, client: TestClient) -> None:
    """The same objects as those of a group: its members by role, former members, strangers, and members who do not name
    the group."""
    count, found = _faults(shared_world, client)
    assert not found, "\n".join(found)
    assert count > 1000, "operations have vanished from the matrix"


def test_the_matrix_finds_a_group_that_anybody_may_name(
    shared_world: World, client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Owners, "role", lambda self, user, group: (Role.EDITOR, {}))
    _, found = _faults(shared_world, client, "/v1/projects")
    assert any("Anna's, stranger: 200 instead of {404}" in line for line in found), found


def test_the_matrix_finds_assets_that_are_served_without_their_owner(
    world: World, client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault that shared links had: the asset of whoever has it."""
    whole = FarmAssets.get
    monkeypatch.setattr(FarmAssets, "get", lambda self, asset_id, owner: _of_anyone(whole, self, asset_id))
    _, found = _faults(world, client, "/v1/shared/")
    assert any("named by Ben's project" in line and "200" in line for line in found), found


def _of_anyone(get: Any, assets: FarmAssets, asset_id: str) -> Asset:
    found: Asset = get(assets, asset_id, ANY_OWNER)
    return found


def test_the_matrix_finds_a_new_route_that_asks_nobody_for_the_owner(world: World, client: TestClient) -> None:
    def get_note(project_id: str, context: Context, caller: Reader) -> str:
        return context.farm.projects.get(project_id).name

    client.app.add_api_route("/v1/projects/{project_id}/note", get_note)  # type: ignore[attr-defined]
    client.app.openapi_schema = None  # type: ignore[attr-defined]
    _, found = _faults(world, client, "/note")
    assert [line.partition(": ")[0] for line in found] == [
        "GET /v1/projects/{project_id}/note, Anna's, other owner's session",
        "GET /v1/projects/{project_id}/note, Anna's, other owner",
        "GET /v1/projects/{project_id}/note, named by Ben's project, owner",
        "GET /v1/projects/{project_id}/note, named by Ben's project, session",
        "GET /v1/projects/{project_id}/note, named by Ben's project, read-only",
    ]


@pytest.mark.parametrize("path", ["/v1/notes/{note_id}", "/v1/projects/{note_id}"])
def test_a_route_whose_objects_are_not_described_fails_the_matrix(world: World, client: TestClient, path: str) -> None:
    client.app.add_api_route(path, lambda note_id: note_id)  # type: ignore[attr-defined]
    client.app.openapi_schema = None  # type: ignore[attr-defined]
    with pytest.raises(Undescribed, match="note_id"):
        next(_cells(world, client))


SOCKETS = {"/v1/live": ("submit", 200), "/v1/live/view": ("read", 404)}
"""WebSocket routes: the scope, and what another owner gets who names Anna's session (the first begins a new one)."""


def test_live_sockets_are_for_owners_with_the_scope(world: World, client: TestClient) -> None:
    app: Any = client.app
    assert {route.path for route in app.routes if isinstance(route, WebSocketRoute)} == SOCKETS.keys()
    for path, (scope, foreign) in SOCKETS.items():
        for name, actor in world.actors.items():
            sessions = app.state.live
            session = LiveSession(sessions.live.place(), world.owner_id, new_id("liv_"))
            session.stream = SimpleNamespace(
                figures=lambda: dict.fromkeys(("received", "painted", "dropped"), 0),
                aclose=_nothing,
                detach=lambda: None,
            )  # type: ignore[assignment]
            sessions._sessions[session.id] = session
            expected = 401 if actor.scopes is None else 200 if actor.may(frozenset({scope})) else 403
            if expected == 200 and actor.owner == BEN:
                expected = foreign
            assert _connected(actor, f"{path}?session={session.id}") == expected, (path, name)
            owned = actor.owner == ANNA and expected == 200 and path == "/v1/live"
            assert (sessions._sessions.pop(session.id, None) is None) == owned, f"{path}: {name} took and left it"
            session.place.release()


def _connected(actor: Actor, path: str) -> int:
    socket = actor.caller.client.websocket_connect(f"ws://127.0.0.1:8420{path}", headers=actor.caller.headers)
    try:
        socket.__enter__()
    except WebSocketDenialResponse as refused:
        return refused.status_code
    with suppress(CancelledError):  # the test client may cancel what the service does when it leaves
        socket.__exit__(None, None, None)
    return 200


async def _nothing() -> None:
    pass
