"""Registration of runtimes before the first import of pyopencl."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from pipeline.compute import runtime


@pytest.fixture(autouse=True)
def environment_is_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    """Restore the environment even if the variable was not set; otherwise later tests find no runtime."""
    monkeypatch.setenv("OCL_ICD_VENDORS", "")
    monkeypatch.delenv("OCL_ICD_VENDORS")


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Runtimes that a new process would register."""
    calls: list[object] = []
    monkeypatch.setattr(runtime, "_prepared", False)
    monkeypatch.setattr(runtime, "register", calls.append)
    monkeypatch.delitem(sys.modules, "pyopencl", raising=False)
    return calls


def test_registration_happens_once(registered: list[object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    runtime.prepare()
    runtime.prepare()
    assert registered == [runtime.intel_runtime()]


def test_the_setting_of_the_user_takes_precedence(registered: list[object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCL_ICD_VENDORS", "/somewhere")
    runtime.prepare()
    assert registered == []


def test_without_the_runtime_nothing_is_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    monkeypatch.setattr(runtime, "_INTEL_PACKAGE", "no-such-package")
    assert runtime.intel_runtime() is None
    runtime.register(runtime.intel_runtime())
    assert "OCL_ICD_VENDORS" not in runtime.os.environ


def test_a_runtime_that_cannot_be_loaded_is_not_registered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    runtime.register(tmp_path / "libintelocl.so")
    assert "OCL_ICD_VENDORS" not in runtime.os.environ


def test_registrations_are_kept_and_one_is_added(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    system = tmp_path / "system"
    system.mkdir()
    (system / "card.icd").write_text("libcard.so\n")
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    monkeypatch.setattr(runtime, "SYSTEM_VENDORS", system)
    monkeypatch.setattr(runtime, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr(runtime, "_load_libraries", lambda folder: True)
    runtime.register(Path("/wheel/libintelocl.so"))
    chosen = Path(runtime.os.environ["OCL_ICD_VENDORS"])
    assert {f.name: f.read_text() for f in chosen.iterdir()} == {
        "card.icd": "libcard.so\n",
        "impasto-intel-cpu.icd": "/wheel/libintelocl.so\n",
    }
    assert runtime._vendors({"card.icd": "libcard.so", "impasto-intel-cpu.icd": "/wheel/libintelocl.so"}) == chosen
    monkeypatch.delenv("OCL_ICD_VENDORS")
