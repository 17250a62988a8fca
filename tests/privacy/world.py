"""What the cells of the privacy matrix are about: the objects of two owners, and everybody who may ask for them."""

from __future__ import annotations

import base64
import io
import time
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fastapi.testclient import TestClient

from service.projects.tokens import Claims, sign
from service.webhooks.secrets import WebhookSecrets
from tests.privacy.actors import Caller, one_shot
from tests.service.driven_farm import MAGIC, DrivenFarm
from workers.contract.owners import OwnerKind, Role
from workers.operator_views import DrainScope

SECRET = "anna-secret"
"""Part of every name and of all bytes of Anna's objects."""
ANNA, BEN, NOBODY = "anna", "ben", ""
BOTH = frozenset({"read", "submit"})


@dataclass(frozen=True)
class Actor:
    """Somebody who sends requests.

    Attributes:
        owner: whose objects are theirs.
        scopes: of a valid key; None: without one, or with one that is no longer valid.
        link: their token of Anna's project; "": none.
        link_lives: whether that token must still work.
        stranger: whether they name a group to which they do not belong.
        chooses: whether they choose the members of Anna's group.
        member: whether they are a member of it who does not name it.
    """

    caller: Caller
    owner: str = NOBODY
    scopes: frozenset[str] | None = None
    link: str = ""
    link_lives: bool = False
    stranger: bool = False
    chooses: bool = False
    member: bool = False

    def may(self, scopes: frozenset[str]) -> bool:
        return self.scopes is not None and ("admin" in self.scopes or scopes <= self.scopes)


class World:
    """Objects of Anna, a project of Ben that names Anna's asset, and the actors.

    Args:
        shared: whether the objects belong to a group of Anna's instead.
    """

    def __init__(self, client: TestClient, farm: DrivenFarm, home: Path, folder: Path, shared: bool = False) -> None:
        self._client, self._farm, self._folder = client, farm, folder
        self._secret = WebhookSecrets(home / "webhook_secret")
        keys = farm.keys
        anna, secret = keys.create(f"{SECRET}-key", ["read", "submit"])
        self._group = farm.owners.add(f"{SECRET} group", OwnerKind.GROUP).id
        self._member = farm.owners.add("member", OwnerKind.USER).id
        farm.owners.put_member(self._group, anna.owner, Role.OWNER)
        self.owner_id = self._group if shared else anna.owner
        self._at = f"/groups/{self._group}" if shared else ""
        self.anna = Caller(client, secret, self._at)
        self.ben = Caller(client, keys.create("ben", ["read", "submit"])[1])
        self.ids = self._objects("clip")
        self.outside = self._objects("other")
        self.thief = {**self.ids, "project": self._project(self.ben, self.ids["asset"], "Ben")}
        self.thief["comment"] = self._comment(self.thief["project"], "Ben's own")
        self.thief["link"] = self._link(self.thief["project"], keys.list()[1].id)
        self.actors = self._members(anna.owner) if shared else self._actors(anna.owner)

    def fresh(self) -> Mapping[str, str]:
        """New objects of Anna, to be deleted."""
        for job in self._farm.jobs.page("active").items:
            self._farm.jobs.cancel(job.id)  # the farm finishes the only unfinished job
        self._farm.workers.resume(DrainScope.QUEUE)
        self._farm.owners.put_member(self._group, self._member, Role.VIEWER)
        return {**self._objects(f"fresh{time.monotonic_ns()}"), "key": self._farm.keys.create("k", ["read"])[0].id}

    def fresh_part(self, ids: Mapping[str, str]) -> Mapping[str, str]:
        """The same objects with a new comment on their project, to be deleted."""
        return {**ids, "comment": self._comment(ids["project"], "new")}

    def _objects(self, name: str) -> dict[str, str]:
        path = self._folder / f"{SECRET}-{name}.mp4"
        path.write_bytes(MAGIC + f"{SECRET} {name}".encode())
        asset = self.anna.upload(path, path.name)
        request = {"method": "toy", "inputs": {"video": asset}, "name": f"{SECRET} job"}
        job = self._finished(self.anna("POST", "/v1/jobs", request).json()["id"])
        project = self._project(self.anna, asset, f"{SECRET} project")
        made = self.anna("POST", f"/v1/projects/{project}/jobs", {}).json()["items"][0]["job"]["id"]
        key = self._farm.keys.list()[0].id
        return {
            "asset": asset, "job": job, "task": self._farm.tasks.page(job).items[0].id, "project": project,
            "group": self._group, "member": self._member, "upload": self._upload(), "film": self._finished(made),
            "link": self._link(project, key), "comment": self._comment(project, f"{SECRET} comment"),
        }  # fmt: skip

    def _finished(self, job: str) -> str:
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, "w") as entries:
            entries.writestr("a.svg", f"<svg>{SECRET}</svg>")
        files = {"svg": (archive.getvalue(), "application/zip")}
        files |= dict.fromkeys(("poster", "sheet", "preview"), (SECRET.encode(), "image/jpeg"))
        keys = {}
        for name, (data, media_type) in files.items():
            self._farm.blobs.put(f"jobs/{job}/{name}", data)
            keys[name] = (f"jobs/{job}/{name}", media_type)
        self._farm._run(job, keys)
        return self._farm.finish(job, f"{SECRET} result".encode()).id

    def _project(self, owner: Caller, asset: str, name: str) -> str:
        return owner.project({**one_shot(asset, "toy"), "name": name}).rpartition("/")[2]

    def _comment(self, project: str, text: str) -> str:
        return self._farm.comments.add(project, "s1", 0, "", text, by_link=False).id

    def _upload(self) -> str:
        name = base64.b64encode(f"{SECRET}.mp4".encode()).decode()
        tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "8", "Upload-Metadata": f"filename {name}"}
        return str(self.anna("POST", "/v1/uploads", **tus).headers["location"]).rpartition("/")[2]

    def _link(self, project: str, maker: str, seconds: float = 3600.0) -> str:
        epoch = self._farm.projects.share_epoch(project)
        return sign(Claims(project, maker, epoch, int(time.time() + seconds), comments=True), self._secret.master())

    def _actors(self, owner: str) -> dict[str, Actor]:
        keys, at = self._farm.keys, self.ids["project"]

        def own(*scopes: str, session: bool = False) -> Actor:
            key, secret = keys.create("anna", scopes, owner=owner, session=session)
            return Actor(Caller(self._client, secret, session=session), ANNA, frozenset(key.scopes), chooses=True)

        ben = keys.list()[1].owner
        session = keys.create("ben", ["read", "submit"], owner=ben, session=True)[1]

        gone = {}
        for name, end in (("replaced key", keys.rotate), ("revoked key", keys.revoke)):
            key, secret = keys.create(name, ["read", "submit"], owner=owner)
            gone[name] = Actor(Caller(self._client, secret), ANNA, link=self._link(at, key.id))
            end(key.id)
        token, late = self.ids["link"], self._link(at, self._farm.keys.list()[0].id, -1.0)
        admin = keys.create("admin", ["admin"])[1]
        return {
            "owner": Actor(self.anna, ANNA, BOTH, chooses=True),
            "session": own("read", "submit", session=True),
            "other owner's session": Actor(Caller(self._client, session, session=True), BEN, BOTH),
            "read-only": own("read"),
            "submit-only": own("submit"),
            "other owner": Actor(self.ben, BEN, BOTH),
            "admin": Actor(Caller(self._client, admin), "admin", frozenset({"admin"}), chooses=True),
            "link": Actor(Caller(self._client, token), link=token, link_lives=True),
            "expired link": Actor(Caller(self._client, late), link=late),
            "nobody": Actor(Caller(self._client)),
            **gone,
        }

    def _members(self, anna: str) -> dict[str, Actor]:
        """Members of the group by role, and those who are none, each under the group's address and beside it."""
        owners, keys = self._farm.owners, self._farm.keys
        session = keys.create("anna", BOTH, owner=anna, session=True)[1]
        found = {
            "owner": Actor(self.anna, ANNA, BOTH, chooses=True),
            "session": Actor(Caller(self._client, session, self._at, session=True), ANNA, BOTH, chooses=True),
            "other owner": Actor(self.ben, BEN, BOTH),
        }
        for role, scopes in ((Role.EDITOR, BOTH), (Role.VIEWER, frozenset({"read"}))):
            key, secret = keys.create(role, BOTH)
            owners.put_member(self._group, key.owner, role)
            found[role] = Actor(Caller(self._client, secret, self._at), ANNA, scopes)
            found[f"{role} outside the group"] = Actor(Caller(self._client, secret), NOBODY, BOTH, member=True)
        key, secret = keys.create("former", BOTH)
        owners.put_member(self._group, key.owner, Role.OWNER)
        owners.remove_member(self._group, key.owner)
        found["former member"] = Actor(Caller(self._client, secret, self._at), BEN, BOTH, stranger=True)
        found["stranger"] = Actor(Caller(self._client, self.ben.key, self._at), BEN, BOTH, stranger=True)
        admin = keys.create("admin", ["admin"])[1]
        found["admin"] = Actor(Caller(self._client, admin, self._at), ANNA, frozenset({"admin"}), chooses=True)
        return found
