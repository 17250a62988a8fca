"""Exports of a finished film: one job per format, hidden from other owners, deleted with the film."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.service.driven_farm import MAGIC, DrivenFarm
from workers.contract.record import ANY_OWNER, RunState
from workers.errors import NotFound

FILM = MAGIC + b" painted"


def export(client: TestClient, job: str, form: str = "gif", **more: Any) -> Any:
    return client.post(f"/v1/jobs/{job}/exports", json={"format": form, **more})


def test_an_export_is_a_job_that_converts_the_film(client: TestClient, farm: DrivenFarm, job: str) -> None:
    farm.finish(job, FILM)
    answer = export(client, job)
    made = answer.json()
    assert (answer.status_code, made["request"]["method"]) == (201, "convert")
    assert made["request"]["output"]["format"] == "gif"
    assert set(made["request"]["inputs"]) == {"video", "film"}
    assert answer.headers["location"] == made["links"]["self"]
    assert [one["id"] for one in client.get(f"/v1/jobs/{job}/exports").json()["items"]] == [made["id"]]


def test_the_same_format_again_is_the_same_export(client: TestClient, farm: DrivenFarm, job: str) -> None:
    farm.finish(job, FILM)
    first = export(client, job).json()["id"]
    again = export(client, job)
    assert (again.status_code, again.json()["id"]) == (200, first)
    assert export(client, job, "webm").json()["id"] != first


@pytest.mark.parametrize("state", [RunState.FAILED, RunState.CANCELLED])
def test_an_export_that_failed_is_made_anew(client: TestClient, farm: DrivenFarm, job: str, state: RunState) -> None:
    farm.finish(job, FILM)
    first = export(client, job).json()["id"]
    farm.move(first, state)
    again = export(client, job)
    assert again.status_code == 201 and again.json()["id"] != first
    assert client.get(f"/v1/jobs/{first}").status_code == 404


def test_an_unfinished_job_has_no_film_to_export(client: TestClient, job: str) -> None:
    answer = export(client, job)
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")


def test_exports_and_gifs_are_not_exported_again(
    client: TestClient, farm: DrivenFarm, job: str, body: dict[str, Any]
) -> None:
    farm.finish(job, FILM)
    made = export(client, job).json()["id"]
    farm.finish(made)
    assert export(client, made, "mp4").status_code == 409
    gif = client.post("/v1/jobs", json=body | {"output": {"format": "gif"}}).json()["id"]
    farm.finish(gif)
    assert "png" in export(client, gif, "mp4").json()["remedy"]


def test_deleting_a_job_deletes_its_exports_and_the_asset_of_its_film(
    client: TestClient, farm: DrivenFarm, job: str
) -> None:
    farm.finish(job, FILM)
    made = export(client, job).json()
    film = made["request"]["inputs"]["film"]
    assert client.delete(f"/v1/jobs/{job}").status_code == 409, "the export is not finished"
    farm.finish(made["id"])
    assert client.delete(f"/v1/jobs/{job}").status_code == 204
    assert client.get(f"/v1/jobs/{made['id']}").status_code == 404
    assert client.get(f"/v1/assets/{film}").status_code == 404


def test_the_film_counts_for_no_quota_and_is_not_listed_for_its_owner(farm: DrivenFarm, client: TestClient) -> None:
    """Without keys all assets are listed; the owner of the film's asset is the job."""
    video = client.post("/v1/assets", files={"file": ("clip.mp4", MAGIC)}).json()["id"]
    job = client.post("/v1/jobs", json={"method": "toy", "inputs": {"video": video}}).json()["id"]
    farm.finish(job, FILM)
    film = export(client, job).json()["request"]["inputs"]["film"]
    assert [asset.id for asset in farm.assets.page(owner=job).items] == [film]


def test_a_label_of_another_owner_makes_no_export(farm: DrivenFarm, client: TestClient, job: str) -> None:
    farm.finish(job, FILM)
    film = farm.jobs.get(job)
    intruder = farm.exports.make(job, film.request.output)
    farm.finish(intruder.id)
    with pytest.raises(NotFound):  # neither the video nor the film is theirs
        farm.jobs.submit(intruder.request, owner="key_other")
    for asset_id in intruder.request.inputs.values():
        with farm.files.local(farm.assets.file(asset_id, ANY_OWNER)) as path:
            farm.assets.add(path, "copy.mp4", "key_other")
    other = farm.jobs.submit(intruder.request, owner="key_other")
    farm.finish(other.id)
    assert other.id not in [one.id for one in farm.exports.of(job)]
    assert client.delete(f"/v1/jobs/{job}").status_code == 204
    assert farm.jobs.get(other.id).state is RunState.SUCCEEDED
