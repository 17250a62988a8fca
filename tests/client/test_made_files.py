"""Files of the client that are made from others are up to date."""

from __future__ import annotations

import importlib.util
from types import ModuleType

from tests.conftest import ROOT


def _script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "client" / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_sync_client_is_made_from_the_async_one() -> None:
    made = _script("make_sync").modules()
    assert len(made) >= 6
    for path, text in made.items():
        assert path.read_text("utf-8") == text, "run `python client/make_sync.py`"


def test_the_types_are_those_of_the_api() -> None:
    script = _script("make_models")
    assert script.FILE.read_text("utf-8") == script.document(), "run `python client/make_models.py`"
