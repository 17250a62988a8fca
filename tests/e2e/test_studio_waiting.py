"""Messages of the pages before and while a film waits: damage of the source, and the position in the queue."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.e2e.pages import Watched, make_clip
from tests.e2e.studio import SOON_MS
from tests.pipeline.video.making import make_video, picture
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(300)]


def upload(service: str, path: Path) -> str:
    return str(HTTP.post(f"{service}/v1/assets", files={"file": (path.name, path.read_bytes())}).json()["id"])


def test_the_studio_names_the_damage_of_its_source(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    path = make_video(tmp_path / "cut.mkv", [picture(i) for i in range(24)], "mjpeg", "yuvj420p")
    data = path.read_bytes()
    pictures = [at for at in range(len(data)) if data[at : at + 3] == b"\xff\xd8\xff"]
    path.write_bytes(data[: pictures[11] + 5])
    shot = {"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": "abstraction"}]}
    document = {"schema": 2, "name": "Cut", "assets": {"clip": {"id": upload(service, path)}}, "shots": [shot]}
    project = HTTP.post(f"{service}/v1/projects", json={"name": "Cut", "document": document}).json()["id"]
    page.goto(f"{service}/#/projects/{project}")
    notice = page.get_by_role("note").filter(has_text="The file is damaged: frames 11-23 of 24 are missing.")
    expect(notice).to_be_visible(timeout=SOON_MS)


def test_a_queued_job_tells_how_many_jobs_are_ahead(watched: Watched, service: str, tmp_path: Path) -> None:
    page = watched.page
    long = upload(service, make_clip(tmp_path / "long.mp4", size=(640, 352), frames=240))
    body = {"method": "multistyle", "inputs": {"video": long}, "params": {}}
    jobs = [HTTP.post(f"{service}/v1/jobs", json={**body, "seed": seed}).json()["id"] for seed in range(3)]
    urgent = HTTP.post(f"{service}/v1/jobs", json={**body, "priority": 5}).json()["id"]
    queue = HTTP.get(f"{service}/v1/jobs/{jobs[2]}/queue").json()
    assert queue["jobs_ahead"] == 3 and queue["seconds"] > 0
    page.goto(f"{service}/#/jobs/{jobs[2]}")
    hint = page.locator(".progress-hint")
    expect(hint).to_have_text(re.compile("^Queued, 3 jobs ahead, (about|less than)"), timeout=SOON_MS)
    for job in (urgent, *jobs[:2]):
        assert HTTP.post(f"{service}/v1/jobs/{job}/cancel").status_code == 200
    expect(hint).not_to_have_text(re.compile("ahead"), timeout=SOON_MS)
    assert HTTP.get(f"{service}/v1/jobs/{jobs[2]}/queue").json()["jobs_ahead"] == 0
    HTTP.post(f"{service}/v1/jobs/{jobs[2]}/cancel")
