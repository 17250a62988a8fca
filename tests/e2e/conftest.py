"""Fixtures of the tests in Chromium: one service and one browser for all test files of a process."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Playwright, expect, sync_playwright

from service import bundle
from tests.e2e.pages import CHROMIUM_ARGS, SHELL, SLOW_MS, Watched, make_clip, open_page, serve
from tests.waiting import HTTP

expect.set_options(timeout=SLOW_MS)  # instead of 5 s: a wait ends with its event, however busy the machine is


@pytest.fixture(scope="package")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames, 96x64 px."""
    return make_clip(tmp_path_factory.mktemp("page") / "disc & field.mp4")


@pytest.fixture(scope="package")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a service with one worker. Other test files use it too, so it also has their jobs and projects."""
    yield from serve(tmp_path_factory.mktemp("service") / "home")


@pytest.fixture(scope="package")
def playwright() -> Iterator[Playwright]:
    """One for all tests: a second one cannot run in the same thread."""
    with sync_playwright() as made:
        yield made


@pytest.fixture(scope="package")
def browser(playwright: Playwright) -> Iterator[Browser]:
    program = shutil.which(SHELL) or shutil.which("chromium")
    chromium = playwright.chromium.launch(executable_path=program, args=CHROMIUM_ARGS)
    yield chromium
    chromium.close()


@pytest.fixture(scope="package")
def video(service: str, clip: Path) -> str:
    """The uploaded clip: twelve frames, 96 x 64 px, a disc that moves to the right."""
    answer = HTTP.post(f"{service}/v1/assets", files={"file": (clip.name, clip.read_bytes())})
    return str(answer.json()["id"])


@pytest.fixture(scope="package")
def kept(browser: Browser) -> Iterator[list[Watched]]:
    """The page that `watched` passes from test to test; none before the first test and after a failed one."""
    pages: list[Watched] = []
    yield pages
    for watched in pages:
        watched.page.context.close()


@pytest.fixture
def watched(kept: list[Watched], browser: Browser, service: str, request: pytest.FixtureRequest) -> Iterator[Watched]:
    """A page that tests share, one after the other: it shows the start page, and nothing is in its storage. To open a
    page takes 1.4 s of processor time, to go to another project 0.4. Tests that need a new page use `fresh`."""
    if kept and kept[0].lost:  # another test has killed Chromium's renderers
        kept.pop().page.context.close()
    if not kept:
        kept.append(open_page(browser))
    watched, failed = kept[0], request.session.testsfailed
    watched.forget()
    yield watched
    if watched.lost or request.session.testsfailed > failed:
        kept.pop().page.context.close()
    else:
        watched.leave(service)


@pytest.fixture
def fresh(browser: Browser) -> Iterator[Watched]:
    """A new page of a new browser context."""
    watched = open_page(browser)
    yield watched
    watched.page.context.close()


@pytest.fixture
def phone(browser: Browser) -> Iterator[Watched]:
    watched = open_page(browser, viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True)
    yield watched
    watched.page.context.close()


@pytest.fixture(scope="package")
def axe() -> str:
    """The source of axe-core, which checks pages for accessibility."""
    bundle.install_packages(tools=True)
    return (bundle.WEB / "node_modules/axe-core/axe.min.js").read_text()
