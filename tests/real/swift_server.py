"""One of Swift's servers as a process: `python -m tests.real.swift_server proxy|account|container|object CONF`.

Swift looks for its common settings in /etc/swift only; here they are beside CONF.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

MODULES = {"proxy": "proxy", "account": "account", "container": "container", "object": "obj"}


def main(kind: str, conf: str) -> None:
    utils = import_module("swift.common.utils")
    utils.SWIFT_CONF_FILE = str(Path(conf).with_name("swift.conf"))
    server = import_module(f"swift.{MODULES[kind]}.server")
    run_wsgi = import_module("swift.common.wsgi").run_wsgi
    more = {"global_conf_callback": server.global_conf_callback} if kind == "object" else {}
    sys.exit(run_wsgi(conf, f"{kind}-server", **more))


if __name__ == "__main__":
    main(*sys.argv[1:])
