"""The TypeScript types that openapi-typescript generates, with openapi-fetch, work with a real service."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from service import bundle
from service.settings import Settings
from tests.service.live import running
from workers.farm import open_farm

KEY = "a-long-secret-of-the-operator"
SESSION = "test/client-session.ts"


def test_the_types_are_those_of_the_service() -> None:
    bundle.write_api_types()
    text = (bundle.TYPES / "api.d.ts").read_text()
    assert '"/v1/jobs/{job_id}/events": {' in text
    assert "JobOutList: {" in text
    assert not bundle.write_api_types(), "nothing has changed since"


def test_upload_submit_list_and_events(home: Path, tiny_clip: Path) -> None:
    bundle.install_packages()
    settings = Settings(home=home, farm="local", workers=1, admin_key=KEY)
    farm = open_farm(settings)
    farm.start()
    with running(settings, farm) as url:
        command = [str(bundle.node()), SESSION, url, KEY, str(tiny_clip)]
        done = subprocess.run(command, cwd=bundle.WEB, capture_output=True, text=True, timeout=120)
    farm.stop()
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["width"] == 96
    assert '"succeeded"' in said["lastEvent"]
    assert said["listed"] == [said["job"]]
    assert said["resultBytes"] > 1000
    assert said["refusedField"] == "method"
