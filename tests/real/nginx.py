"""A real nginx in a temporary folder, with the configuration that we ship and a certificate of its own."""

from __future__ import annotations

import shutil
import ssl
import subprocess
from pathlib import Path

from tests.ports import free_port
from tests.real.processes import end, listens, start, until

SHIPPED = Path(__file__).resolve().parents[2] / "deploy" / "nginx" / "impasto.conf"
_MAIN = """
daemon off;
master_process off;
pid {folder}/pid;
error_log {folder}/log;
events {{ worker_connections 256; }}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    include {folder}/impasto.conf;
}}
"""


def missing() -> str:
    """Why there can be no server here; empty if there can."""
    lacks = [name for name in ("nginx", "openssl") if shutil.which(name) is None]
    return f"there is no {lacks[0]}: apt-get install nginx-light openssl" if lacks else ""


class Nginx:
    """The proxy in front of the service at `behind` ("host:port")."""

    def __init__(self, folder: Path, behind: str) -> None:
        self.folder, self.port, self.plain_port = folder, free_port(), free_port()
        names = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
        made = ["-newkey", "rsa:2048", "-nodes", "-keyout", f"{folder}/key.pem", "-out", f"{folder}/fullchain.pem"]
        subprocess.run(["openssl", "req", "-x509", "-days", "2", *made, *names], check=True, capture_output=True)
        text = SHIPPED.read_text()
        for shipped, ours in {
            "127.0.0.1:8420": behind,
            "listen 80;": f"listen 127.0.0.1:{self.plain_port};",
            "listen 443 ssl": f"listen 127.0.0.1:{self.port} ssl",
            "/etc/impasto/tls": str(folder),
            "impasto.example": "localhost",
        }.items():
            assert shipped in text, f"{shipped} is not in {SHIPPED.name}"
            text = text.replace(shipped, ours)
        (folder / "impasto.conf").write_text(text)
        (folder / "nginx.conf").write_text(_MAIN.format(folder=folder))
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"https://localhost:{self.port}"

    @property
    def trust(self) -> ssl.SSLContext:
        return ssl.create_default_context(cafile=str(self.folder / "fullchain.pem"))

    def start(self) -> None:
        log = self.folder / "stderr"
        self._process = start(["nginx", "-c", str(self.folder / "nginx.conf")], log)
        until(lambda: listens(self.port), self._process, log)

    def close(self) -> None:
        if self._process is not None:
            end(self._process)
