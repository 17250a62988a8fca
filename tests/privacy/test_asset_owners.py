"""Every way to an asset goes through the entry of an owner: projects, links, jobs, retries, previews, deletion."""

from __future__ import annotations

import ast
import io
import zipfile
from pathlib import Path

import pytest

from tests.privacy.actors import ADMIN, Caller, one_shot, service
from workers.contract.request import JobRequest
from workers.errors import NotFound
from workers.farm import Farm

ROOT = Path(__file__).parents[2]
OPERATORS = {
    "workers/contract/record.py": "defines it",
    "service/access/keys.py": "callers with the scope admin",
    "workers/store/assets.py": "serves it",
    "workers/farm_parts/assets.py": "compares the stored bytes of all assets",
}
"""Modules that may name the assets of all owners, with the reason."""
UNKNOWN = f"ast_{'0' * 64}"


def test_only_named_modules_reach_the_assets_of_all_owners() -> None:
    found = set()
    for folder in ("workers", "service", "impasto"):
        for path in (ROOT / folder).rglob("*.py"):
            if "ANY_OWNER" in {node.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)}:
                found.add(str(path.relative_to(ROOT)))
    assert found == OPERATORS.keys()


def _owner(client: object, farm: Farm) -> Caller:
    return Caller(client, farm.keys.create("owner", ["read", "submit"])[1])  # type: ignore[arg-type]


def test_a_project_that_names_the_asset_of_another_owner_gets_nothing_of_it(
    home: Path, farm: Farm, tiny_clip: Path
) -> None:
    with service(home, farm) as client:
        anna, ben, nobody = _owner(client, farm), _owner(client, farm), Caller(client)
        asset = anna.upload(tiny_clip, "anna secret.mp4")
        at = ben.project(one_shot(asset))
        served = nobody("GET", f"{ben.share(at)}/assets/{asset}/content")
        assert served.status_code == 404 and "secret" not in f"{served.text}{served.headers}"
        found = ben("GET", f"{at}/check").json()["errors"]
        assert [error["message"] for error in found] == ["The asset is not on the server."]
        for path, body in (
            (f"{at}/jobs", {}),
            (f"{at}/previews/source", {"shot": "s1"}),
            ("/v1/estimates", {"project": at.rpartition("/")[2]}),
        ):
            assert ben("POST", path, body).status_code == 422, path
        archive = zipfile.ZipFile(io.BytesIO(ben("GET", f"{at}/export").content))
        assert archive.namelist() == ["project.json"]
        admin = Caller(client, ADMIN)
        assert admin("DELETE", f"/v1/assets/{asset}").status_code == 204, "a use without an entry holds nothing"


def test_a_link_does_not_tell_whether_another_owner_has_an_asset(home: Path, farm: Farm, tiny_clip: Path) -> None:
    with service(home, farm) as client:
        anna, ben, nobody = _owner(client, farm), _owner(client, farm), Caller(client)
        asset = anna.upload(tiny_clip, "film.mp4")
        answers = []
        for asset_id in (asset, UNKNOWN):
            answer = nobody("GET", f"{(link := ben.share(ben.project(one_shot(asset_id))))}/assets/{asset_id}/content")
            answers.append(answer.text.replace(asset_id, "ID").replace(link, "LINK"))
        assert answers[0] == answers[1]


def test_an_ended_share_ends_the_access_of_those_who_know_the_ids(home: Path, farm: Farm, tiny_clip: Path) -> None:
    with service(home, farm) as client:
        anna, ben, nobody = _owner(client, farm), _owner(client, farm), Caller(client)
        asset = anna.upload(tiny_clip, "film.mp4")
        project = anna.project(one_shot(asset))
        link = f"{anna.share(project)}/assets/{asset}/content"
        assert nobody("GET", link).content == tiny_clip.read_bytes()
        anna("DELETE", f"{project}/share")
        assert nobody("GET", link).status_code == 410
        again = f"{ben.share(ben.project(one_shot(asset)))}/assets/{asset}/content"
        assert nobody("GET", again).status_code == 404
        assert ben.upload(tiny_clip, "mine.mp4") == asset, "who has the bytes gets an entry of their own"
        assert "mine.mp4" in nobody("GET", again).headers["content-disposition"]


def test_a_job_uses_only_assets_of_its_owner_also_when_it_is_retried(farm: Farm, tiny_clip: Path) -> None:
    asset = farm.assets.add(tiny_clip, "film.mp4", "anna")
    request = JobRequest("multistyle", {"video": asset.id})
    with pytest.raises(NotFound, match="not found"):
        farm.jobs.submit(request, "ben")
    farm.assets.add(tiny_clip, "copy.mp4", "ben")
    job = farm.jobs.submit(request, "ben")
    farm.jobs.cancel(job.id)
    farm.assets.delete(asset.id, "ben")
    with pytest.raises(NotFound) as refused:
        farm.jobs.retry(job.id)
    assert (refused.value.field, refused.value.value) == ("inputs.video", asset.id)
