"""The list of licences: what metadata says in words becomes SPDX, and libraries in wheels are found."""

from __future__ import annotations

import importlib.util
from email.message import Message
from importlib.metadata import PackagePath
from types import ModuleType
from typing import Any

import pytest

from tests.conftest import ROOT


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("licences", ROOT / ".ci" / "licences.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Installed:
    """A distribution with this metadata and these files."""

    version, requires = "1.0", None

    def __init__(self, files: tuple[str, ...] = (), **facts: str) -> None:
        self.files = [PackagePath(name) for name in files]
        self.metadata: Any = Message()
        for name, value in ({"Name": "thing"} | facts).items():
            self.metadata[name.replace("_", "-")] = value


@pytest.mark.parametrize(
    ("facts", "licence"),
    [
        ({"License_Expression": "MIT AND PSF-2.0"}, "MIT AND PSF-2.0"),
        ({"License": "BSD 3-Clause License\n\nCopyright (c) 2022"}, "BSD-3-Clause"),
        ({"Classifier": "License :: OSI Approved :: Mozilla Public License 2.0 (MPL 2.0)"}, "MPL-2.0"),
        ({"License": "Intel End User License Agreement for Developer Tools"}, "LicenseRef-Intel-EULA"),
    ],
)
def test_licences_become_spdx(script: ModuleType, facts: dict[str, str], licence: str) -> None:
    assert script.licence_of(Installed(**facts)) == licence


def test_a_package_without_a_licence_stops_the_list(script: ModuleType) -> None:
    with pytest.raises(LookupError, match="thing names no licence"):
        script.licence_of(Installed())


def test_libraries_under_the_gpl_are_found_in_wheels(script: ModuleType) -> None:
    files = ("a.libs/libx265-1a2b3c4d.so.215", "a.libs/libheif-0f0f0f0f.so.1.2", "a.libs/libdav1d-00aa11bb.so.7")
    inside = list(script.libraries(Installed(files)))
    assert inside == [("libheif", "LGPL-3.0-or-later"), ("libx265", "GPL-2.0-or-later")]
    text = script.notice({"thing": Installed(files, License="MIT")})
    assert "thing 1.0 contains libheif (LGPL-3.0-or-later), libx265 (GPL-2.0-or-later)." in text


def test_the_notice_names_the_encoders_and_the_runtime_of_intel() -> None:
    text = (ROOT / "NOTICE").read_text()
    assert all(word in text for word in ("libx264", "libx265", "intel-opencl-rt", "psycopg-binary"))
