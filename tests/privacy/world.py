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
from workers.operator_views import DrainScope

SECRET = "anna-secret"
"""Part of every name and of all bytes of Anna's objects."""
ANNA, BEN, NOBODY = "anna", "ben", ""


@dataclass(frozen=True)
class Actor:
    """Somebody who sends requests.

    Attributes:
        owner: whose objects are theirs.
        scopes: of a valid key; None: without one, or with one that is no longer valid.
        link: their token of Anna's project; "": none.
        link_lives: whether that token must still work.
    """

    caller: Caller
    owner: str = NOBODY
    scopes: frozenset[str] | None = None
    link: str = ""
    link_lives: bool = False

    def may(self, scopes: frozenset[str]) -> bool:
        return self.scopes is not None and ("admin" in self.scopes or scopes <= self.scopes)


class World:
    """Objects of Anna, a project of Ben that names Anna's asset, and the actors."""

    def __init__(self, client: TestClient, farm: DrivenFarm, home: Path, folder: Path) -> None:
        self._client, self._farm, self._folder = client, farm, folder
        self._secret = WebhookSecrets(home / "webhook_secret")
        keys = farm.keys
        anna, secret = keys.create(f"{SECRET}-key", ["read", "submit"])
        self.owner_id = anna.owner
        self.anna = Caller(client, secret)
        self.ben = Caller(client, keys.create("ben", ["read", "submit"])[1])
        self.ids = self._objects("clip")
        self.outside = self._objects("other")
        self.thief = {**self.ids, "project": self._project(self.ben, self.ids["asset"], "Ben")}
        self.thief["link"] = self._link(self.thief["project"], keys.list()[1].id)
        self.actors = self._actors(anna.owner)

    def fresh(self) -> Mapping[str, str]:
        """New objects of Anna, to be deleted."""
        for job in self._farm.jobs.page("active").items:
            self._farm.jobs.cancel(job.id)  # the farm finishes the only unfinished job
        self._farm.workers.resume(DrainScope.QUEUE)
        return {**self._objects(f"fresh{time.monotonic_ns()}"), "key": self._farm.keys.create("k", ["read"])[0].id}

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
            "upload": self._upload(), "film": self._finished(made), "link": self._link(project, key),
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

    def _upload(self) -> str:
        name = base64.b64encode(f"{SECRET}.mp4".encode()).decode()
        tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "8", "Upload-Metadata": f"filename {name}"}
        return str(self.anna("POST", "/v1/uploads", **tus).headers["location"]).rpartition("/")[2]

    def _link(self, project: str, maker: str, seconds: float = 3600.0) -> str:
        epoch = self._farm.projects.share_epoch(project)
        return sign(Claims(project, maker, epoch, int(time.time() + seconds)), self._secret.master())

    def _actors(self, owner: str) -> dict[str, Actor]:
        keys, at = self._farm.keys, self.ids["project"]

        def own(*scopes: str) -> Actor:
            key, secret = keys.create("anna", scopes, owner=owner)
            return Actor(Caller(self._client, secret), ANNA, frozenset(key.scopes))

        gone = {}
        for name, end in (("replaced key", keys.rotate), ("revoked key", keys.revoke)):
            key, secret = keys.create(name, ["read", "submit"], owner=owner)
            gone[name] = Actor(Caller(self._client, secret), ANNA, link=self._link(at, key.id))
            end(key.id)
        token, late = self.ids["link"], self._link(at, self._farm.keys.list()[0].id, -1.0)
        admin = keys.create("admin", ["admin"])[1]
        return {
            "owner": Actor(self.anna, ANNA, frozenset({"read", "submit"})),
            "read-only": own("read"),
            "submit-only": own("submit"),
            "other owner": Actor(self.ben, BEN, frozenset({"read", "submit"})),
            "admin": Actor(Caller(self._client, admin), "admin", frozenset({"admin"})),
            "link": Actor(Caller(self._client, token), link=token, link_lives=True),
            "expired link": Actor(Caller(self._client, late), link=late),
            "nobody": Actor(Caller(self._client)),
            **gone,
        }
