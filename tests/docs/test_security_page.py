"""docs/security.md: every row of its table names existing tests, and its statements about the code are true."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "security.md").read_text()
ROWS = [row for row in PAGE.splitlines() if row.startswith("| ") and "`tests/" in row]
OURS = ("impasto", "service", "workers", "pipeline")


def named() -> list[tuple[str, str]]:
    return re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)


@cache
def sources() -> list[tuple[str, ast.Module]]:
    paths = [path for package in OURS for path in sorted((ROOT / package).rglob("*.py"))]
    return [(str(path.relative_to(ROOT)), ast.parse(path.read_text())) for path in paths]


def test_the_security_table_exists() -> None:
    assert len(ROWS) >= 30
    for row in re.findall(r"^\| (?!threat|---)(.*) \|$", PAGE.split("## Threats")[1].split("\n## ")[0], re.M):
        assert "`tests/" in row, f"no test for: {row}"


@pytest.mark.parametrize(("path", "name"), sorted(set(named())), ids=lambda word: str(word).rpartition("/")[2])
def test_named_tests_exist(path: str, name: str) -> None:
    assert name in _functions(path)


@cache
def _functions(path: str) -> frozenset[str]:
    """Names of the functions and methods in a file."""
    tree = ast.parse((ROOT / path).read_text())
    return frozenset(n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))


@cache
def calls() -> list[tuple[str, str, ast.Call]]:
    """Path, called function, and the call."""
    found = [(path, node) for path, tree in sources() for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [(path, ast.unparse(node.func), node) for path, node in found]


def test_code_uses_no_pickle_eval_or_shell() -> None:
    """Ray unpickles on its own private connections; our code unpickles only what it has written itself."""
    bad = re.compile(
        r"^(pickle|marshal|shelve|dill)\.|^(eval|exec|compile|__import__)$|^os\.(system|popen)$|yaml\.(load|unsafe)"
    )
    found = {(path, name) for path, name, _ in calls() if bad.search(name)}
    assert found == set()
    clouds = {path for path, name, _ in calls() if "cloudpickle" in name}
    rooms = ("workers/live/ray_actor.py", "workers/live/ray_workers.py", "workers/previews/ray_actor.py")
    assert clouds <= {*rooms, "workers/previews/ray_runner.py"}
    assert not [node for _, _, node in calls() if any(key.arg == "shell" for key in node.keywords)]


def test_arrays_are_loaded_without_pickle() -> None:
    loads = [(path, node) for path, name, node in calls() if name in ("np.load", "numpy.load")]
    for path, node in loads:
        allowed = [key.value for key in node.keywords if key.arg == "allow_pickle"]
        assert [ast.unparse(value) for value in allowed] == ["False"], path


def test_only_listed_modules_open_connections() -> None:
    """The service itself connects only to its stores, to Ray, to webhooks through the guarded pool, and to the
    operator's OpenID provider."""
    modules = {"httpx", "httpcore", "requests", "urllib.request", "aiohttp", "smtplib", "ftplib"}
    found = {path for path, tree in sources() for name in _imports(tree) if name in modules}
    found = {path for path in found if path.startswith(("service", "workers", "pipeline"))}
    assert found == {"service/webhooks/connect.py", "service/webhooks/sender.py", "service/users/sign_in.py"}


def _imports(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_only_listed_modules_decode_media() -> None:
    """Child processes decode user files; the listed modules read files of the service itself, or a live frame."""
    decoders = {
        "VideoReader",
        "NumberedImages",
        "decode_rgb",
        "decode_raw",
        "cv2.imdecode",
        "open_container",
        "av.open",
    }
    decoders |= {"read_exr", "join", "probe"}
    found = {(path, name) for path, name, _ in calls() if name in decoders and path.startswith(("workers", "service"))}
    results = {("workers/execution/assembly.py", "VideoReader"), ("workers/execution/result_quality.py", "VideoReader")}
    ours = results | {("service/scenes/routes.py", "join")}
    live = {("workers/live/codecs.py", "cv2.imdecode")}
    assert found == ours | live


def test_secrets_are_compared_in_constant_time() -> None:
    where = {path for path, name, _ in calls() if name.endswith("compare_digest")}
    assert {"service/access/gate.py", "workers/store/keys.py"} <= where


def test_bandit_rules_are_enabled_for_all_code() -> None:
    lint = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["ruff"]["lint"]
    assert "S" in lint["select"]
    assert not [code for code in lint["ignore"] if code.startswith("S") and code != "S101"]
    assert not [place for place in lint["per-file-ignores"] if place.startswith(OURS)]


def test_sql_statements_are_never_built_from_values() -> None:
    """SQL text contains only constants and names from our code, never a value of a request."""
    for path, name, node in calls():
        if name in ("text", "sqlalchemy.text", "sa.text") and path.startswith(("workers/store", "service")):
            assert not isinstance(node.args[0], ast.BinOp) or "migrations" in path, path


def test_printed_settings_contain_no_secret() -> None:
    from service.settings import Settings

    given = {
        "database_url": "postgresql://a:hidden@b/c",
        "s3_secret_key": "hidden",
        "s3_access_key": "hidden",
        "admin_key": "hidden",
        "webhook_secret": "hidden" * 8,
        "oidc_client_secret": "hidden",
    }
    assert "hidden" not in repr(Settings.model_validate(given))
