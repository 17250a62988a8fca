"""Write what an installation contains: NOTICE, docs/licences.md and build/sbom.cdx.json (CycloneDX 1.6).

    python .ci/licences.py           # writes them
    python .ci/licences.py --check   # exit status 1 if the first two are not those of the installed packages

The packages are those that `impasto` with all extras for users requires, as they are installed here. Licences come from
their metadata; libraries under the GPL or LGPL in wheels are found by their file names.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution
from pathlib import Path

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from packageurl import PackageURL
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("cpu", "webrtc", "window", "cluster", "cuts", "oidc", "s3", "postgresql")
OURS = ("impasto", "impasto-client")
INTEL = "LicenseRef-Intel-EULA"
SPDX = (
    (r"Intel|Proprietary", INTEL),
    (r"Mozilla|MPL", "MPL-2.0"),
    (r"LGPL.?v?2\.1|Lesser General Public License \(LGPL\)", "LGPL-2.1-only"),
    (r"BSD.?2|BSD 2-Clause|2-Clause BSD", "BSD-2-Clause"),
    (r"BSD", "BSD-3-Clause"),
    (r"Apache", "Apache-2.0"),
    (r"\bMIT\b", "MIT"),
    (r"ISC", "ISC"),
    (r"PSF|Python Software Foundation", "PSF-2.0"),
    (r"Unlicense", "Unlicense"),
)
"""(Words in older metadata, SPDX identifier), tried in this order."""
STATED = {"python-dateutil": "Apache-2.0 OR BSD-3-Clause", "openexr": "BSD-3-Clause", "opencolorio": "BSD-3-Clause"}
"""Licences whose metadata name none, or two: read in the packages."""
COPYLEFT = (
    (r"libx264|libx265", "GPL-2.0-or-later"),
    (r"libheif|libde265|libhogweed|libnettle|libgmp|libunistring", "LGPL-3.0-or-later"),
    (
        r"libav(codec|device|filter|format|util)|libsw(scale|resample)|libgnutls|libmp3lame|libasound",
        "LGPL-2.1-or-later",
    ),
    (r"mpg123|libsndfile|libfluidsynth|libSDL2_mixer", "LGPL-2.1-or-later"),
)
"""(File names of libraries in wheels, licence)."""
_LIBRARY = re.compile(r"(lib[A-Za-z0-9_]+?)(?:-[0-9a-f]{6,}.*|[-.]\d.*|\.so.*)$")


def installed() -> dict[str, Distribution]:
    """The distributions of an installation of Impasto with every extra for users, by name."""
    found: dict[str, Distribution] = {}
    left, seen = [("impasto", EXTRAS)], set()
    while left:
        name, extras = left.pop()
        if (name, extras) not in seen:
            seen.add((name, extras))
            found[name] = distribution(name)
            left += needs(found[name], extras)
    return dict(sorted(found.items()))


def needs(found: Distribution, extras: tuple[str, ...]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """(Name, extras) of each distribution that one requires on this machine."""
    for row in found.requires or ():
        needed = Requirement(row)
        marker = needed.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in extras or ("",)):
            yield canonicalize_name(needed.name), tuple(sorted(needed.extras))


def licence_of(found: Distribution) -> str:
    """The SPDX expression of a distribution. Raises LookupError."""
    facts, name = found.metadata, canonicalize_name(found.metadata["Name"])
    if name in STATED:
        return STATED[name]
    if facts["License-Expression"]:
        return str(facts["License-Expression"])
    classifiers = [text for text in facts.get_all("Classifier") or () if text.startswith("License")]
    for text in ((facts["License"] or "")[:400], *classifiers):
        for words, identifier in SPDX:
            if re.search(words, text):
                return identifier
    raise LookupError(f"{name} names no licence: read it and add it to STATED")


def libraries(found: Distribution) -> Iterator[tuple[str, str]]:
    """(Library, licence) of each library under the GPL or LGPL in a wheel."""
    names = {match[1] for file in found.files or () if (match := _LIBRARY.match(file.name))}
    for name in sorted(names):
        for words, licence in COPYLEFT:
            if re.match(words, name):
                yield name, licence


def notice(found: dict[str, Distribution]) -> str:
    """The file NOTICE."""
    rows = []
    for name, each in found.items():
        inside = list(libraries(each))
        if inside:
            listed = ", ".join(f"{library} ({licence})" for library, licence in inside)
            rows.append(f"{name} {each.version} contains {listed}.")
        if re.search(r"GPL|MPL|LicenseRef", licence_of(each)):
            rows.append(f"{name} {each.version}: {licence_of(each)}.")
    head = """Impasto
Copyright the authors of Impasto

Licensed under the Apache License, Version 2.0 (LICENSE). The source and the wheels contain no other project's code.
What is installed beside them has licences of its own (docs/licences.md). These ask more of those who pass an
installation or an image on than to keep their text (docs/operations.md, "Licences of what is installed"):

"""
    return head + "\n".join(rows) + "\n"


def page(found: dict[str, Distribution]) -> str:
    """The page docs/licences.md."""
    head = """# Licences

Packages of an installation with all extras for users, with the versions of `constraints.txt`, on Linux x86-64.
`python .ci/licences.py` writes this page, [NOTICE](../NOTICE), and a bill of materials, `build/sbom.cdx.json`
(CycloneDX 1.6); `make audit` compares both with the installed packages. The obligations of those who
redistribute an image are in [operations](operations.md#licences-of-what-is-installed).

| package | version | licence | libraries under the GPL or LGPL in its wheel |
|---|---|---|---|
"""
    rows = []
    for name, each in found.items():
        licence = licence_of(each).replace(INTEL, "Intel end user licence")
        inside = ", ".join(f"{library}: {of}" for library, of in libraries(each))
        if name not in OURS:
            rows.append(f"| {name} | {each.version} | {licence} | {inside} |")
    return head + "\n".join(rows) + "\n"


def sbom(found: dict[str, Distribution]) -> str:
    """A CycloneDX document without date and serial number, so that equal installations have equal documents."""
    factory, parts = LicenseFactory(), {}
    for name, each in found.items():
        licence = factory.make_from_string(licence_of(each))
        inside = [Component(name=library, type=ComponentType.LIBRARY, licenses=[factory.make_from_string(of)],
                            bom_ref=f"{name}/{library}") for library, of in libraries(each)]  # fmt: skip
        parts[name] = Component(
            name=name, version=each.version, type=ComponentType.LIBRARY, licenses=[licence], bom_ref=name,
            purl=PackageURL("pypi", None, name, each.version), components=inside,
        )  # fmt: skip
    bom = Bom(components=[part for name, part in parts.items() if name != "impasto"])
    bom.metadata.component = parts["impasto"]
    for name, each in found.items():
        required = {other for other, _extras in needs(each, EXTRAS)} - {name}
        bom.register_dependency(parts[name], [parts[other] for other in sorted(required) if other in parts])
    text = make_outputter(bom, OutputFormat.JSON, SchemaVersion.V1_6).output_as_string(indent=1)
    text = re.sub(r'\n "serialNumber": "[^"]*",?', "", text)
    return re.sub(r'\n  "timestamp": "[^"]*",?', "", text).rstrip() + "\n"


def main(check: bool) -> int:
    found = installed()
    texts = {"NOTICE": notice(found), "docs/licences.md": page(found)}
    if check:
        stale = [name for name, text in texts.items() if (ROOT / name).read_text("utf-8") != text]
        state = f"{', '.join(stale)}: run python .ci/licences.py" if stale else "licences as listed"
        print(f"{len(found)} packages: {state}")
        return 1 if stale else 0
    (ROOT / "build").mkdir(exist_ok=True)
    texts["build/sbom.cdx.json"] = sbom(found)
    for name, text in texts.items():
        (ROOT / name).write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
