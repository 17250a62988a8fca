"""A shared link ends with what made it: its key, the admin key, or the open service."""

from __future__ import annotations

from pathlib import Path

from tests.privacy.actors import ADMIN, Caller, one_shot, service
from workers.farm import Farm

OTHER = "another admin key, which replaces the first"


def test_a_link_ends_with_the_admin_key_that_made_it(home: Path, farm: Farm) -> None:
    with service(home, farm) as client:
        admin = Caller(client, ADMIN)
        link = admin.share(admin.project({"schema": 2, "name": "Swan"}))
        assert Caller(client)("GET", link).status_code == 200
    for changes, status in (({"admin_key": OTHER}, 410), ({"admin_key": None}, 410), ({}, 200)):
        with service(home, farm, **changes) as client:
            assert Caller(client)("GET", link).status_code == status, changes


def test_a_link_of_an_open_service_ends_when_keys_are_required(home: Path, farm: Farm) -> None:
    with service(home, farm, auth="auto", admin_key=None) as client:
        anyone = Caller(client)
        link = anyone.share(anyone.project({"schema": 2, "name": "Swan"}))
        assert anyone("GET", link).status_code == 200
    with service(home, farm) as client:
        assert Caller(client)("GET", link).status_code == 410


def test_a_link_ends_with_its_key_when_that_is_replaced_or_revoked(home: Path, farm: Farm) -> None:
    with service(home, farm) as client:
        admin, nobody = Caller(client, ADMIN), Caller(client)
        first, secret = farm.keys.create("anna", ["read", "submit"])
        project = Caller(client, secret).project({"schema": 2, "name": "Swan"})
        link = Caller(client, secret).share(project)
        second = admin("POST", f"/v1/keys/{first.id}/rotate").json()
        assert nobody("GET", link).status_code == 410
        link = Caller(client, second["secret"]).share(project)
        assert nobody("GET", link).status_code == 200
        farm.keys.revoke(second["key"]["id"])
        assert nobody("GET", link).status_code == 410


def test_a_key_without_the_scope_read_makes_no_link(home: Path, farm: Farm, tiny_clip: Path) -> None:
    with service(home, farm) as client:
        only = Caller(client, farm.keys.create("machine", ["submit"])[1])
        project = only.project(one_shot(only.upload(tiny_clip, "film.mp4")))
        refused = only("POST", f"{project}/share", {})
        assert refused.status_code == 403 and "'read'" in refused.text
