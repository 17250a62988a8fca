"""Users, groups and quotas; who did what; what it has cost; what is deleted by age."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import pytest
from fastapi.testclient import TestClient

from service.access import audit
from service.app import ROUTERS, create_app
from service.settings import Settings
from tests.service.conftest import CLIP
from tests.service.driven_farm import DrivenFarm
from workers.contract.owners import OwnerKind, RetentionRule, Role

Login = Callable[..., TestClient]


@pytest.fixture
def login(settings: Settings, farm: DrivenFarm) -> Login:
    """A client of a user with this name and these scopes; `at`: the address of a group."""
    app = create_app(settings.model_copy(update={"auth": "required"}), farm)

    def client(name: str, *scopes: str, at: str = "") -> TestClient:
        known = next((owner.id for owner in farm.owners.all() if owner.name == name), None)
        _, secret = farm.keys.create(name, scopes or ("read", "submit"), owner=known)
        headers = {"Authorization": f"Bearer {secret}"}
        return TestClient(app, f"http://127.0.0.1:8420{at}", headers=headers, raise_server_exceptions=False)

    return client


def _user(client: TestClient) -> str:
    return str(client.get("v1/me").json()["user"])


def _asset(client: TestClient, name: str = "a.mp4") -> str:
    return str(client.post("v1/assets", files={"file": (name, CLIP)}).json()["id"])


def _job(client: TestClient, **labels: str) -> str:
    body = {"method": "toy", "inputs": {"video": _asset(client)}, "labels": labels}
    return str(client.post("v1/jobs", json=body).json()["id"])


def test_a_group_shares_projects_jobs_and_styles(login: Login, farm: DrivenFarm) -> None:
    admin, anna, ben, stranger = login("root", "admin"), login("anna"), login("ben"), login("eve")
    group = admin.post("v1/ops/owners", json={"kind": "group", "name": "Show"}).json()["id"]
    at = f"/v1/groups/{group}/members"
    assert admin.put(f"{at}/{_user(anna)}", json={"role": "owner"}).json()["role"] == "owner"
    assert anna.put(f"{at}/{_user(ben)}", json={"role": "viewer"}).status_code == 200
    assert anna.get("v1/me").json()["groups"] == [{"group": group, "name": "Show", "role": "owner"}]

    place = f"/groups/{group}"
    anna, ben, stranger = (login(name, at=place) for name in ("anna", "ben", "eve"))
    style, job = _asset(anna, "style.mp4"), _job(anna)
    made = anna.post("v1/projects", json={"name": "Film"})
    project = made.json()
    assert made.headers["location"] == project["links"]["self"] == f"{place}/v1/projects/{project['id']}"
    for path in (f"v1/assets/{style}", f"v1/jobs/{job}", f"v1/projects/{project['id']}"):
        assert ben.get(path).status_code == 200, path
        assert stranger.get(path).status_code == 404, path
        assert login("ben").get(path).status_code == 404, "it is the group's, not the member's"
    assert [each["id"] for each in ben.get("v1/projects").json()["items"]] == [project["id"]]

    change = {"If-Match": "*", "Content-Type": "application/merge-patch+json"}
    path = f"v1/projects/{project['id']}"
    assert ben.patch(path, content=b'{"name": "Cut"}', headers=change).status_code == 403
    assert admin.put(f"{at}/{_user(ben)}", json={"role": "editor"}).status_code == 200
    assert ben.patch(path, content=b'{"name": "Cut"}', headers=change).status_code == 200
    authors = [version["author"] for version in anna.get(f"{path}/versions").json()["items"]]
    assert authors == [_user(ben), _user(anna)], "the newest first"
    eve = _user(login("eve"))
    assert stranger.put(f"v1/groups/{group}/members/{eve}", json={"role": "viewer"}).status_code == 404
    assert login("eve").get(f"v1/groups/{group}/members").status_code == 404


def test_only_a_groups_owners_choose_its_members(login: Login, farm: DrivenFarm) -> None:
    group = farm.owners.add("Show", OwnerKind.GROUP).id
    clients = {name: login(name) for name in ("anna", "ben", "cleo", "eve")}
    for name, role in (("anna", Role.OWNER), ("ben", Role.EDITOR), ("cleo", Role.VIEWER)):
        farm.owners.put_member(group, _user(clients[name]), role)
    eve = f"/v1/groups/{group}/members/{_user(clients['eve'])}"
    expected = {"anna": 200, "ben": 403, "cleo": 403, "eve": 404}
    for name, status in expected.items():
        assert clients[name].put(eve, json={"role": "viewer"}).status_code == status, name
        if name == "anna":
            assert clients["anna"].delete(eve).status_code == 204
    assert clients["anna"].put(f"/v1/groups/{group}/members/usr_none", json={"role": "viewer"}).status_code == 404
    assert clients["anna"].put(f"/v1/groups/{group}/members/{group}", json={"role": "viewer"}).status_code == 404
    assert clients["ben"].delete(f"/v1/groups/{group}/members/{_user(clients['ben'])}").status_code == 204, "may leave"
    assert login("ben", at=f"/groups/{group}").get("v1/projects").status_code == 404


def test_a_key_gives_in_a_group_no_more_than_it_has(login: Login, farm: DrivenFarm) -> None:
    group = farm.owners.add("Show", OwnerKind.GROUP).id
    farm.owners.put_member(group, _user(login("anna")), Role.OWNER)
    reader = login("anna", "read", at=f"/groups/{group}")
    assert reader.get("v1/me").json()["scopes"] == ["read"]
    assert reader.post("v1/projects", json={"name": "x"}).status_code == 403
    farm.owners.change(group, disabled=True)
    assert reader.get("v1/projects").status_code == 404


def test_an_operator_changes_quotas_while_the_user_works(login: Login, farm: DrivenFarm) -> None:
    admin, anna = login("root", "admin"), login("anna")
    at = f"/v1/ops/owners/{_user(anna)}"
    admin.patch(at, json={"quotas": {"active_jobs": 1, "asset_bytes": 10**6}})
    _job(anna)
    body = {"method": "toy", "inputs": {"video": _asset(anna)}, "name": "second"}
    assert anna.post("v1/jobs", json=body).status_code == 429
    assert admin.patch(at, json={"quotas": {"active_jobs": 2}}).json()["quotas"] == {
        "active_jobs": 2, "asset_bytes": 10**6,
    }  # fmt: skip
    assert anna.post("v1/jobs", json=body).status_code == 201
    assert admin.patch(at, json={"quotas": {"active_jobs": None}}).json()["quotas"] == {"asset_bytes": 10**6}
    assert admin.patch(at, json={"quotas": {"jobs": 1}}).status_code == 422
    assert admin.patch("/v1/ops/owners/usr_none", json={"name": "x"}).status_code == 404


def test_a_disabled_user_is_refused_and_loses_nothing(login: Login, farm: DrivenFarm) -> None:
    admin, anna = login("root", "admin"), login("anna")
    project, user = anna.post("v1/projects", json={"name": "x"}).json()["id"], _user(anna)
    admin.patch(f"/v1/ops/owners/{user}", json={"disabled": True})
    assert anna.get("v1/projects").status_code == 401
    admin.patch(f"/v1/ops/owners/{user}", json={"disabled": False})
    assert anna.get(f"v1/projects/{project}").status_code == 200


def test_everything_moves_to_another_owner(login: Login, farm: DrivenFarm) -> None:
    """What the keys of one person made as several owners, and what was made without a key, gets together."""
    admin, anna, old = login("root", "admin"), login("anna"), login("anna before")
    asset, job = _asset(old), _job(old)
    project = old.post("v1/projects", json={"name": "x"}).json()["id"]
    loose = farm.projects.create({"schema": 2, "name": "made without a key", "assets": {}, "shots": []}, "").id
    moved = admin.post(f"/v1/ops/owners/{_user(old)}/transfer", json={"to": _user(anna)}).json()["moved"]
    assert (moved["jobs"], moved["projects"], moved["assets"]) == (1, 1, 1)
    path = "/v1/ops/owners/nobody/transfer"
    assert admin.post(path, json={"to": _user(anna)}).json()["moved"]["projects"] == 1
    for path in (f"v1/assets/{asset}", f"v1/jobs/{job}", f"v1/projects/{project}", f"v1/projects/{loose}"):
        assert anna.get(path).status_code == 200, path
    assert old.get(f"v1/jobs/{job}").status_code == 404
    assert admin.post("/v1/ops/owners/usr_none/transfer", json={"to": _user(anna)}).status_code == 404


def test_keys_expire_and_say_when_they_were_used(
    login: Login, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    admin, now = login("root", "admin"), farm.keys._now()
    body = {"name": "k", "scopes": ["read"], "expires_at": now + 60}
    made = admin.post("v1/keys", json=body).json()
    assert made["key"]["used_at"] is None and made["key"]["expires_at"] == now + 60
    assert farm.keys.verify(made["secret"]) is not None
    assert farm.keys.get(made["key"]["id"]).used_at is not None
    monkeypatch.setattr(farm.keys, "_now", lambda: now + 61)
    assert farm.keys.verify(made["secret"]) is None and not farm.keys.is_valid(made["key"]["id"])
    assert admin.post(f"v1/keys/{made['key']['id']}/rotate").status_code == 409
    assert admin.post("v1/keys", json=body).status_code == 422, "in the past"


def test_who_did_what_is_recorded(login: Login, farm: DrivenFarm) -> None:
    admin, anna = login("root", "admin"), login("anna")
    job, user = _job(anna), _user(anna)
    anna.post(f"v1/jobs/{job}/cancel")
    anna.delete(f"v1/jobs/{job}")
    anna.delete("v1/jobs/job_none")
    anna.get("v1/jobs")
    key = admin.post("v1/keys", json={"name": "k", "scopes": ["read"], "owner": user}).json()["key"]["id"]
    done = admin.get("v1/ops/audit", params={"who": user}).json()["items"]
    assert [(entry["action"], entry["object"]) for entry in done if job in entry["object"]] == [
        ("delete_job", job), ("cancel", job), ("submit", job),
    ]  # fmt: skip
    assert all(entry["user"] == user and entry["address"] for entry in done)
    made = admin.get("v1/ops/audit", params={"about": key}).json()["items"]
    assert [(entry["action"], entry["user"]) for entry in made] == [("create_key", _user(admin))]
    assert admin.get("v1/ops/audit", params={"action": "revoke_key"}).json()["items"] == []
    page = admin.get("v1/ops/audit", params={"limit": 2}).json()
    assert len(page["items"]) == 2
    rest = admin.get("v1/ops/audit", params={"cursor": page["cursor"]}).json()["items"]
    assert not {entry["id"] for entry in rest} & {entry["id"] for entry in page["items"]}
    assert anna.get("v1/ops/audit").status_code == 403
    assert farm.audit.prune(3600) == 0 and farm.audit.prune(-1) == len(page["items"]) + len(rest)


def test_unrecorded_operations_exist() -> None:
    names = {route.name for router in ROUTERS for route in router.routes if hasattr(route, "methods")}
    assert all(any(name.startswith(start) for name in names) for start in audit.UNRECORDED)


def test_costs_are_summed_by_owner_and_label(login: Login, farm: DrivenFarm) -> None:
    admin, anna, ben = login("root", "admin"), login("anna"), login("ben")
    given = ((anna, "heron"), (anna, "=swan"), (ben, "heron"))
    jobs = [farm.finish(_job(client, show=show)).id for client, show in given]
    by_owner = {cost["name"]: cost for cost in admin.get("v1/ops/costs").json()["items"]}
    assert {name: cost["jobs"] for name, cost in by_owner.items()} == {_user(anna): 2, _user(ben): 1}
    by_show = {cost["name"]: cost["jobs"] for cost in admin.get("v1/ops/costs", params={"by": "show"}).json()["items"]}
    assert by_show == {"heron": 2, "=swan": 1}
    anna.delete(f"v1/jobs/{jobs[0]}")
    assert sum(cost["jobs"] for cost in admin.get("v1/ops/costs").json()["items"]) == 3, "a deleted job has cost, too"
    answer = admin.get("v1/ops/costs", params={"by": "show", "format": "csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert {row["name"]: row["jobs"] for row in rows} == {"heron": "2", "'=swan": "1"}, "no formula for spreadsheets"
    assert admin.get("v1/ops/costs", params={"until": 1.0}).json()["items"] == []


def test_rules_delete_old_jobs_and_say_which(login: Login, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch) -> None:
    admin, anna, ben = login("root", "admin"), login("anna"), login("ben")
    given = ((anna, "draft"), (anna, "final"), (ben, "draft"))
    draft, final, other = (farm.finish(_job(client, kind=kind)).id for client, kind in given)
    running = _job(anna)
    now = farm.store.retention._now()
    monkeypatch.setattr(farm.store.retention, "_now", lambda: now + 10 * 86400)
    body = {"days": 7, "label": "kind", "value": "draft", "owner": _user(anna)}
    dry = admin.post("v1/ops/retention?dry_run=true", json=body)
    assert (dry.status_code, dry.json()["due"]) == (200, {"jobs": 1, "first": [draft]})
    assert admin.get("v1/ops/retention").json()["items"] == [] and anna.get(f"v1/jobs/{draft}").status_code == 200
    rule = admin.post("v1/ops/retention", json=body).json()["rule"]["id"]
    assert admin.post("v1/ops/retention", json={"days": 30}).status_code == 201
    assert admin.post("v1/ops/retention/apply").json()["items"] == [draft]
    assert [client.get(f"v1/jobs/{job}").status_code for client, job in
            ((anna, draft), (anna, final), (ben, other), (anna, running))] == [404, 200, 200, 200]  # fmt: skip
    assert not list(farm.blobs.keys(f"jobs/{draft}/"))
    said = admin.get("v1/ops/audit", params={"about": draft, "action": "retention"}).json()["items"]
    assert [entry["user"] for entry in said] == [rule]
    assert admin.delete(f"v1/ops/retention/{rule}").status_code == 204
    assert admin.delete(f"v1/ops/retention/{rule}").status_code == 404
    assert admin.post("v1/ops/retention", json={"days": 1, "value": "x"}).status_code == 422
    monkeypatch.setattr(farm.store.retention, "_now", lambda: now + 31 * 86400)
    assert set(farm.retention.apply()) == {final, other}, "a job that has not ended stays"
    assert farm.retention.due(RetentionRule(0)).jobs == 0
