"""An owner has several keys: everything that one of them made belongs to the owner and outlives each key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from impasto.cli.app import run
from pipeline.errors import BadParameter
from tests.privacy.actors import ADMIN, Caller, one_shot, service
from workers.errors import Conflict, NotFound
from workers.farm import Farm


def test_a_replaced_key_leaves_its_owner_everything(home: Path, farm: Farm, tiny_clip: Path) -> None:
    """Assets, projects, jobs, uploads, quotas and the secret of webhooks."""
    tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "8"}
    with service(home, farm) as client:
        admin = Caller(client, ADMIN)
        made = admin("POST", "/v1/keys", {"name": "anna", "scopes": ["read", "submit"], "quotas": {"active_jobs": 1}})
        owner, old = made.json()["key"]["owner"], Caller(client, made.json()["secret"])
        asset = old.upload(tiny_clip, "film.mp4")
        project = old.project(one_shot(asset))
        job = f"/v1/jobs/{old('POST', f'{project}/jobs', {}).json()['items'][0]['job']['id']}"
        upload = old("POST", "/v1/uploads", **tus).headers["location"]
        secret = old("GET", "/v1/webhooks/secret").text
        new = admin("POST", f"/v1/keys/{made.json()['key']['id']}/rotate").json()
        assert new["key"]["owner"] == owner and new["key"]["quotas"] == {"active_jobs": 1}
        for caller, status in ((old, 401), (Caller(client, new["secret"]), 200)):
            for path in (f"/v1/assets/{asset}", project, job, "/v1/webhooks/secret"):
                assert caller("GET", path).status_code == status, path
            assert caller("HEAD", upload, **tus).status_code == status
        caller = Caller(client, new["secret"])
        assert caller("GET", "/v1/webhooks/secret").text == secret
        assert caller("POST", f"{project}/jobs", {}).status_code == 429, "the quota counts the old key's job"


def test_keys_of_an_owner_are_added_and_revoked_one_by_one(farm: Farm) -> None:
    first, secret = farm.keys.create("anna", ["read"], {"active_jobs": 3})
    second, other = farm.keys.create("anna's laptop", ["read", "submit"], owner=first.owner)
    assert (second.owner, second.quotas) == (first.owner, {"active_jobs": 3}) and second.id != first.id
    farm.keys.revoke(first.id)
    assert farm.keys.verify(secret) is None and farm.keys.verify(other) == second
    third, _ = farm.keys.create("anna's desk", ["read"], owner=first.owner)
    assert third.owner == first.owner, "the owner outlives the key that it is named after"
    with pytest.raises(NotFound):
        farm.keys.create("ben", ["read"], owner="key_none")
    with pytest.raises(BadParameter, match="owner"):
        farm.keys.create("anna", ["read"], {"active_jobs": 9}, owner=first.owner)
    with pytest.raises(Conflict):
        farm.keys.rotate(first.id)
    with pytest.raises(NotFound):
        farm.keys.rotate("key_none")


def test_the_command_adds_and_replaces_keys_of_an_owner(
    home: Path, farm: Farm, capsys: pytest.CaptureFixture[str]
) -> None:
    at = ["--home", str(home), "--json"]

    def keys(*command: str) -> dict[str, str]:
        assert run(["keys", *command, *at]) == 0
        found: dict[str, str] = json.loads(capsys.readouterr().out)
        return found

    first = keys("create", "anna")
    second = keys("create", "laptop", "--owner", first["owner"])
    third = keys("rotate", second["id"])
    assert first["owner"] == second["owner"] == third["owner"] != first["id"]
    assert farm.keys.verify(second["secret"]) is None and farm.keys.verify(third["secret"]) is not None
