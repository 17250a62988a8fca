"""A service that is reached only through a proxy with a password, over TLS with a certificate of the company's own.

The proxy connects every name to the TLS end of a real service. The name is known to nobody else.
"""

from __future__ import annotations

import base64
import datetime
import os
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from impasto.live.client import LiveClient
from impasto_client import BadInput, Client, ServiceUnreachable
from tests.conftest import ROOT
from tests.ports import free_port
from tests.processes import started

HOST = "paint.example"
LOGIN = "anna:secret"
VARIABLES = ("HTTPS_PROXY", "HTTP_PROXY", "ALL_PROXY", "NO_PROXY", "SSL_CERT_FILE", "SSL_CERT_DIR")


def _listen(handle: Callable[[socket.socket], None]) -> tuple[socket.socket, int]:
    """A TCP server on loopback; each connection has a thread."""
    server = socket.create_server(("127.0.0.1", 0))

    def accept() -> None:
        while True:
            try:
                connection, _ = server.accept()
            except OSError:
                return
            threading.Thread(target=handle, args=(connection,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    return server, server.getsockname()[1]


def _relay(one: socket.socket, other: socket.socket) -> None:
    """Copy bytes both ways until one end closes."""

    def copy(source: socket.socket, target: socket.socket) -> None:
        try:
            while data := source.recv(1 << 16):
                target.sendall(data)
        except OSError:
            pass
        finally:
            for end in (source, target):
                end.close()

    threading.Thread(target=copy, args=(other, one), daemon=True).start()
    copy(one, other)


def _authority(folder: Path) -> tuple[Path, Path]:
    """A certificate for `HOST` that is its own authority, and its key, as PEM files."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "The company")])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(1)).not_valid_after(now + datetime.timedelta(1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(HOST)]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )  # fmt: skip
    certificate, secret = folder / "company.pem", folder / "key.pem"
    certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    form = serialization.PrivateFormat.PKCS8
    secret.write_bytes(key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption()))
    return certificate, secret


@dataclass
class Company:
    """Addresses of the proxy and the service, the file of the authority, and the names that the proxy was asked for."""

    proxy: str
    inside: str
    ca_file: Path
    asked: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def company(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Company]:
    home, port = tmp_path_factory.mktemp("home"), free_port()
    certificate, secret = _authority(home)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, secret)
    found = Company("", "", certificate)

    def end_tls(connection: socket.socket) -> None:
        try:
            secure = context.wrap_socket(connection, server_side=True)
        except OSError:  # a client that does not trust the certificate
            connection.close()
            return
        _relay(secure, socket.create_connection(("127.0.0.1", port), timeout=60))

    def connect(connection: socket.socket) -> None:
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += connection.recv(1)
        login = base64.b64encode(LOGIN.encode()).decode()
        if f"proxy-authorization: basic {login}".lower() not in head.decode().lower():
            connection.sendall(b"HTTP/1.1 407 Proxy Authentication Required\r\nContent-Length: 0\r\n\r\n")
            connection.close()
            return
        found.asked.append(head.decode().split()[1])
        connection.sendall(b"HTTP/1.1 200 Connection established\r\n\r\n")
        _relay(connection, socket.create_connection(("127.0.0.1", tls_port), timeout=60))

    tls, tls_port = _listen(end_tls)
    proxy, proxy_port = _listen(connect)
    found.proxy = f"http://{LOGIN}@127.0.0.1:{proxy_port}"
    command = [sys.executable, "-m", "impasto", "serve", "--port", str(port), "--home", str(home / "impasto")]
    env = {**os.environ, "IMPASTO_ALLOWED_HOSTS": f'["{HOST}"]'}
    with closing(tls), closing(proxy), started(command, stdout=subprocess.PIPE, text=True, env=env) as process:
        assert process.stdout is not None
        found.inside = process.stdout.readline().strip()
        yield found


@pytest.fixture
def employee(company: Company, monkeypatch: pytest.MonkeyPatch) -> Company:
    """An environment with the proxy, and nothing of the test machine's."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)
    monkeypatch.setenv("HTTPS_PROXY", company.proxy)
    company.asked.clear()
    return company


def test_a_job_is_painted_through_the_proxy(
    employee: Company, tiny_clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SSL_CERT_FILE", str(employee.ca_file))
    with Client(f"https://{HOST}") as client:
        job = client.submit("abstraction", {"video": client.upload(tiny_clip)["id"]}, {"lines": "off"})
        assert [now["state"] for now in client.watch(job["id"])][-1] == "succeeded"
        assert client.download(job["id"], tmp_path / "out.mp4").stat().st_size
    assert set(employee.asked) == {f"{HOST}:443"}


def test_an_authority_can_be_named_in_a_program(employee: Company, tmp_path: Path) -> None:
    with Client(f"https://{HOST}", ca_file=employee.ca_file) as client:
        assert client.methods()
    with pytest.raises(BadInput, match="ca_file"):
        Client(f"https://{HOST}", ca_file=tmp_path / "none.pem")


def test_a_certificate_that_is_not_trusted_is_explained(employee: Company) -> None:
    with Client(f"https://{HOST}") as client, pytest.raises(ServiceUnreachable, match="SSL_CERT_FILE"):
        client.methods()


def test_the_command_uses_the_proxy(employee: Company) -> None:
    command = [sys.executable, "-m", "impasto", "jobs", "--server", f"https://{HOST}"]
    env = {**os.environ, "SSL_CERT_FILE": str(employee.ca_file)}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and employee.asked == [f"{HOST}:443"], done.stderr


def test_a_live_session_goes_through_the_proxy(employee: Company, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSL_CERT_FILE", str(employee.ca_file))
    with LiveClient(f"https://{HOST}", timeout_s=150, size=(64, 48)) as live:
        live.send(np.full((48, 64, 3), 90, np.uint8))
        assert next(iter(live.answers())) is not None
    assert employee.asked == [f"{HOST}:443"]


def test_no_proxy_is_used_on_this_computer(employee: Company, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:1")
    monkeypatch.setenv("ALL_PROXY", "http://127.0.0.1:1")
    with Client(employee.inside) as client:
        assert client.methods()
    assert employee.asked == []
