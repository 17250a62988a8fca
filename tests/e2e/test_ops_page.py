"""The operations page in Chromium on a real service and a second worker, with real jobs, failures and drains."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.pages import KEY, ROOT, Watched, make_clip, open_page, serve

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

SOON_MS = 60_000


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ops") / "home"


@pytest.fixture(scope="module")
def service(home: Path) -> Iterator[str]:
    yield from serve(home, AUTH="required", ADMIN_KEY=KEY, RETRY_DELAY_S="0.05")


@pytest.fixture(scope="module")
def http(service: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=service, headers={"Authorization": f"Bearer {KEY}"}, timeout=60) as client:
        yield client


@contextmanager
def second_worker(home: Path) -> Iterator[str]:
    """`impasto worker` on the same stores; its id."""
    command = [sys.executable, "-m", "impasto", "worker", "--home", str(home), "--workers", "1"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, env=os.environ)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        assert process.wait(60) == 0


def upload(http: httpx.Client, clip: Path) -> str:
    return str(http.post("/v1/assets", files={"file": (clip.name, clip.read_bytes())}).json()["id"])


def submit(http: httpx.Client, asset: str, name: str, seed: int = 0) -> str:
    body = {"method": "abstraction", "inputs": {"video": asset}, "name": name, "seed": seed}
    return str(http.post("/v1/jobs", json=body).json()["id"])


def enter(page: Page, service: str, key: str = KEY) -> None:
    page.goto(f"{service}/ops")
    page.get_by_label("API key").fill(key)
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_role("heading", name="Operations")).to_be_visible()


def open_ops(browser: Browser, service: str, **options: object) -> Watched:
    """Open the page with the key already in the tab, so that the console shows no refused request."""
    watched = open_page(browser, **options)
    watched.page.add_init_script(f"sessionStorage.setItem('impasto.key', '{KEY}')")
    watched.page.goto(f"{service}/ops")
    expect(watched.page.get_by_role("heading", name="Operations")).to_be_visible()
    return watched


def state_of(page: Page, name: str) -> object:
    row = page.locator("#jobs tr", has=page.get_by_role("button", name=name, exact=True))
    return row.locator(".badge")


def test_the_ops_page_opens_for_admins_only(browser: Browser, service: str, http: httpx.Client) -> None:
    key = http.post("/v1/keys", json={"name": "reader", "scopes": ["read"]}).json()["secret"]
    page = open_page(browser).page
    page.goto(f"{service}/ops")
    page.get_by_label("API key").fill(key)
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_role("alert")).to_contain_text("lacks the scope 'admin'")
    page.get_by_role("button", name="Use another key").click()
    page.get_by_label("API key").fill(KEY)
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_role("heading", name="Operations")).to_be_visible()
    page.context.close()


def test_the_ops_page_shows_a_job_and_its_timeline(
    browser: Browser, service: str, http: httpx.Client, clip: Path
) -> None:
    watched = open_ops(browser, service)
    page = watched.page
    expect(page.get_by_role("region", name="This machine")).to_contain_text("Processors")
    job = submit(http, upload(http, clip), "a disc")
    expect(state_of(page, "a disc")).to_have_text("succeeded", timeout=SOON_MS)  # type: ignore[arg-type]
    expect(page.get_by_role("columnheader", name="Priority")).to_be_visible()
    page.locator("#jobs").get_by_role("button", name="a disc").click()
    bars = page.locator("#timeline rect.bar")
    tasks = http.get(f"/v1/jobs/{job}/tasks").json()["items"]
    expect(bars).to_have_count(sum(len(task["attempts"]) for task in tasks))
    expect(page.get_by_role("heading", name="Timeline of a disc, succeeded")).to_be_visible()
    title = bars.first.locator("title").text_content() or ""
    assert re.search(r"attempt 1 succeeded\n[\d.]+ s\nimpasto-worker-\d+ of dsp_", title), title
    assert len({bars.nth(i).get_attribute("class") for i in range(bars.count())}) == len({t["step"] for t in tasks})
    bars.last.click()
    expect(page.locator(".timeline-chosen .log")).to_be_visible()
    watched.check()
    page.context.close()


def test_a_failed_task_is_inspected_and_retried(
    browser: Browser, service: str, http: httpx.Client, home: Path, tmp_path: Path
) -> None:
    clip = make_clip(tmp_path / "lost.mp4", frames=6)
    asset = upload(http, clip)
    blob = next(file for file in (home / "blobs").rglob("*") if file.is_file() and asset[4:] in str(file))
    kept = blob.rename(tmp_path / "kept")
    watched = open_ops(browser, service)
    page = watched.page
    submit(http, asset, "a lost film")
    expect(state_of(page, "a lost film")).to_have_text("failed", timeout=SOON_MS)  # type: ignore[arg-type]
    failed = page.locator(".failed", has_text="a lost film").first
    failed.get_by_role("button", name="Log").click()
    expect(failed.locator(".log")).to_contain_text(asset[4:20])
    kept.rename(blob)
    failed.get_by_role("button", name="Run again").click()
    expect(state_of(page, "a lost film")).to_have_text("succeeded", timeout=SOON_MS)  # type: ignore[arg-type]
    expect(failed.locator(".failure-head .badge")).to_have_text("task succeeded", timeout=SOON_MS)
    expect(failed.locator(".log")).to_be_visible()
    watched.check()
    page.context.close()


def test_a_worker_is_drained_and_the_queue_paused(
    browser: Browser, service: str, http: httpx.Client, home: Path, clip: Path
) -> None:
    watched = open_ops(browser, service)
    page = watched.page
    asset = upload(http, clip)
    with second_worker(home) as worker:
        row = page.locator("#workers tbody tr", has_text="service")
        other = page.locator("#workers tbody tr", has_text=worker.split("@")[0][-6:])
        expect(other.locator(".badge")).to_have_text("live", timeout=SOON_MS)
        row.get_by_role("button", name="Drain").click()
        page.get_by_label("Why").fill("a new kernel")
        page.get_by_role("dialog").get_by_role("button", name="Drain").click()
        expect(row.locator(".badge")).to_have_text("drained")
        expect(row).to_contain_text("a new kernel")
        job = submit(http, asset, "elsewhere", seed=2)
        expect(state_of(page, "elsewhere")).to_have_text("succeeded", timeout=SOON_MS)  # type: ignore[arg-type]
        bars = http.get(f"/v1/ops/jobs/{job}/timeline").json()["items"]
        assert {bar["worker"] for bar in bars} == {worker}
        page.get_by_role("button", name="Pause the queue").click()
        page.get_by_role("dialog").get_by_role("button", name="Leave it").click()
        assert not http.get("/v1/ops/queue").json()["paused"]
        page.get_by_role("button", name="Pause the queue").click()
        page.get_by_role("dialog").get_by_role("button", name="Pause the queue").click()
        expect(page.get_by_role("button", name="Resume the queue")).to_be_visible()
        row.get_by_role("button", name="Resume").click()
        expect(row.locator(".badge")).to_have_text("live")
        job = submit(http, asset, "waits", seed=3)
        page.wait_for_timeout(3000)
        assert http.get(f"/v1/ops/jobs/{job}/timeline").json()["items"] == []
        page.get_by_role("button", name="Resume the queue").click()
        expect(state_of(page, "waits")).to_have_text("succeeded", timeout=SOON_MS)  # type: ignore[arg-type]
    expect(other).to_have_count(0, timeout=SOON_MS)
    watched.check()
    page.context.close()


def test_the_ops_page_fits_a_phone(browser: Browser, service: str, http: httpx.Client, clip: Path) -> None:
    submit(http, upload(http, clip), "small film")
    watched = open_ops(
        browser, service, viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True, color_scheme="dark"
    )
    page = watched.page
    for target in (".link", ".select-target", "input[type=search]", "select"):
        found = page.locator("#jobs").locator(target).first
        expect(found).to_be_visible()
        size = found.bounding_box()
        assert size is not None and size["height"] >= 44, target
    page.locator("#jobs .link").first.click()
    expect(page.locator("#timeline svg")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    box = page.locator("#timeline svg").bounding_box()
    assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 390
    watched.check()
    page.context.close()


def test_jobs_are_searched_moved_to_the_front_and_acted_on_together(
    browser: Browser, service: str, http: httpx.Client, clip: Path
) -> None:
    http.post("/v1/ops/queue/pause")
    asset = upload(http, clip)
    blue, red = (submit(http, asset, name, seed=seed) for seed, name in ((11, "blue one"), (12, "red one")))
    watched = open_ops(browser, service)
    page = watched.page
    rows = page.locator("#jobs tbody tr")
    page.get_by_label("Search jobs").fill("ED ON")
    expect(rows).to_have_count(1)
    rows.get_by_role("button", name="First").click()
    expect(page.get_by_label("Priority of red one")).to_have_value("1")
    assert http.get(f"/v1/jobs/{blue}/queue").json()["jobs_ahead"] == 1
    page.get_by_label("Search jobs").fill("one")
    expect(rows).to_have_count(2)
    page.get_by_label("Priority of blue one").fill("-5")
    page.get_by_label("Priority of blue one").press("Tab")
    page.get_by_label("Select red one").check()
    page.get_by_label("Select blue one").check()
    group = page.get_by_role("group", name="Selected jobs")
    expect(group).to_contain_text("2 jobs selected")
    group.get_by_role("button", name="Cancel").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    for name in ("red one", "blue one"):
        expect(state_of(page, name)).to_have_text("cancelled", timeout=SOON_MS)  # type: ignore[arg-type]
    assert http.get(f"/v1/jobs/{blue}").json()["request"]["priority"] == -5
    page.get_by_label("Select red one").check()
    group.get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(rows).to_have_count(1)
    assert http.get(f"/v1/jobs/{red}").status_code == 404
    http.post("/v1/ops/queue/resume")
    watched.check()
    page.context.close()
