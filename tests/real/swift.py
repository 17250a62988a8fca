"""A real S3 server in a temporary folder: OpenStack Swift with its S3 interface, four processes, one replica.

It checks signatures, keeps open multipart uploads and objects over kill -9, and answers 503 while its object server is
away, which is how a store that is away looks.
"""

from __future__ import annotations

import importlib.util
import itertools
import os
import pwd
import signal
import subprocess
import sys
import tempfile
from functools import cached_property
from pathlib import Path
from typing import Any

import boto3
from botocore.config import Config

from tests.ports import free_port
from tests.real.processes import delete_later, end, listens, start, until

ROOT = Path(__file__).resolve().parents[2]
ACCESS_KEY, SECRET_KEY, REGION = "test:tester", "testing", "us-east-1"

_COMMON = """[DEFAULT]
bind_ip = 127.0.0.1
bind_port = {port}
workers = 0
user = {user}
swift_dir = {folder}
devices = {folder}/devices
mount_check = false
disable_fallocate = true
log_level = WARNING
eventlet_debug = false
"""
_PROXY = """
[pipeline:main]
pipeline = catch_errors gatekeeper healthcheck cache bulk s3api tempauth slo dlo versioned_writes proxy-server
[app:proxy-server]
use = egg:swift#proxy
account_autocreate = true
allow_account_management = true
node_timeout = 10
conn_timeout = 1
error_suppression_interval = 0
error_suppression_limit = 1000000
[filter:catch_errors]
use = egg:swift#catch_errors
[filter:gatekeeper]
use = egg:swift#gatekeeper
[filter:healthcheck]
use = egg:swift#healthcheck
[filter:cache]
paste.filter_factory = tests.real.swift_cache:filter_factory
[filter:bulk]
use = egg:swift#bulk
[filter:s3api]
use = egg:swift#s3api
s3_acl = false
[filter:tempauth]
use = egg:swift#tempauth
user_test_tester = testing .admin
[filter:slo]
use = egg:swift#slo
[filter:dlo]
use = egg:swift#dlo
[filter:versioned_writes]
use = egg:swift#versioned_writes
allow_versioned_writes = true
"""
_BACK = """
[pipeline:main]
pipeline = {kind}-server
[app:{kind}-server]
use = egg:swift#{kind}
"""
_SWIFT = """[swift-hash]
swift_hash_path_suffix = impasto
[storage-policy:0]
name = one
default = yes
"""
_BACKENDS = ("account", "container", "object")

_RING = """import sys
from swift.common.ring import RingBuilder
for port, path in zip(sys.argv[1::2], sys.argv[2::2]):
    builder = RingBuilder(part_power=4, replicas=1, min_part_hours=0)
    device = {"id": 0, "region": 1, "zone": 1, "ip": "127.0.0.1", "port": int(port), "device": "d1", "weight": 1.0}
    builder.add_dev(device)
    builder.rebalance(seed=1)
    builder.get_ring().save(path)
"""


def missing() -> str:
    """Why there can be no server here; empty if there can."""
    if not importlib.util.find_spec("swift"):
        return "swift is not installed: pip install 'impasto[dev]'"
    with tempfile.NamedTemporaryFile(prefix="impasto-") as file:
        try:
            os.setxattr(file.name, "user.impasto", b"1")
        except OSError as error:
            return f"the temporary folder keeps no extended attributes, which Swift needs: {error}"
    return ""


class Swift:
    """The four servers, through stops and kills."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="impasto-s3-"))
        self._ports = {kind: free_port() for kind in ("proxy", *_BACKENDS)}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._numbers = itertools.count(1)
        (self.folder / "devices" / "d1").mkdir(parents=True)
        (self.folder / "swift.conf").write_text(_SWIFT)
        for kind, port in self._ports.items():
            text = _COMMON + (_PROXY if kind == "proxy" else _BACK)
            conf = text.format(port=port, user=_user(), folder=self.folder, kind=kind)
            (self.folder / f"{kind}.conf").write_text(conf)
        self._make_rings()

    def _make_rings(self) -> None:
        """Run Swift in a separate process: it loads eventlet, which leaves a green `http.server` behind in ours."""
        given = [word for kind in _BACKENDS for word in (str(self._ports[kind]), str(self.folder / f"{kind}.ring.gz"))]
        subprocess.run([sys.executable, "-W", "ignore", "-c", _RING, *given], check=True)

    @property
    def endpoint(self) -> str:
        return f"http://127.0.0.1:{self._ports['proxy']}"

    def start(self, *kinds: str) -> None:
        """Start these servers, or all of them, and wait until they listen."""
        for kind in kinds or tuple(self._ports):
            command = [sys.executable, "-m", "tests.real.swift_server", kind, str(self.folder / f"{kind}.conf")]
            env = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore"}
            self._processes[kind] = start(command, self._log(kind), env)
        for kind in kinds or tuple(self._ports):
            until(lambda k=kind: listens(self._ports[k]), self._processes[kind], self._log(kind))  # type: ignore[misc]

    def stop(self, *kinds: str, how: signal.Signals = signal.SIGKILL) -> None:
        """End these servers, or all of them."""
        for kind in kinds or tuple(self._ports):
            end(self._processes[kind], how)

    def runs(self, kind: str) -> bool:
        return self._processes[kind].poll() is None

    def close(self) -> None:
        """Stop it finally and delete its folder."""
        self.stop()
        delete_later(self.folder)

    def client(self) -> Any:
        """An S3 client with valid keys, for inspecting the server."""
        config = Config(s3={"addressing_style": "path"}, retries={"max_attempts": 1})
        keys = {"aws_access_key_id": ACCESS_KEY, "aws_secret_access_key": SECRET_KEY}
        return boto3.client("s3", endpoint_url=self.endpoint, region_name=REGION, config=config, **keys)

    def bucket(self) -> str:
        """The name of a new, empty bucket."""
        name = f"bucket-{next(self._numbers)}"
        self.client().create_bucket(Bucket=name)
        return name

    @cached_property
    def shared_bucket(self) -> str:
        """A server with one existing bucket."""
        return self.bucket()

    def _log(self, kind: str) -> Path:
        return self.folder / f"{kind}.log"


def _user() -> str:
    return pwd.getpwuid(os.getuid()).pw_name
