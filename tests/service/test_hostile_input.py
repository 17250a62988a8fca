"""Arbitrary hostile input: every parser accepts it or raises an error of this project, never any other exception."""

from __future__ import annotations

import asyncio
import io
import ipaddress
import json
import math
import socket
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some
from starlette.datastructures import Headers

from pipeline.errors import BadInput, ImpastoError
from pipeline.formats import image_format_of
from pipeline.formats.decoding import decode_rgb
from pipeline.video.archive import open_archive, read_entry
from pipeline.video.guard.wire import ConnectionBroken, receive
from pipeline.video.media import Limits
from pipeline.video.stills import encode_png
from service.access.admission import Admission, Cost, classes
from service.access.gate import KEY_PROTOCOL, _bearer, _offered
from service.access.keys import Principal, Scope
from service.errors import Busy, RangeNotSatisfiable
from service.serving import disposition, wanted
from service.settings import Settings
from service.uploads.headers import Checksum, filename, whole_number
from service.webhooks.targets import check_target, is_public
from tests.conftest import tiny_frame
from workers.blobs.keys import check_key
from workers.execution.arrays import read_arrays
from workers.filenames import check_filename
from workers.strict_json import strict_json

CHEAP = settings(
    max_examples=200, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
SMALL = Limits(size_bytes=1 << 20, pixels=1 << 16, side_px=1024, frames=100)
latin = some.text(some.characters(max_codepoint=255), max_size=60)
"""Characters that a header can contain."""
LOCAL = ("127.0.0.1", "10.1.2.3", "169.254.169.254", "0.0.0.0", "224.0.0.1")
LOCAL_6 = ("::1", "fe80::1", "fd00::1", "::ffff:10.0.0.1", "64:ff9b::7f00:1", "2002:7f00:1::",
           "::127.0.0.1", "::ffff:0:127.0.0.1", "64:ff9b:1::7f00:1", "fec0::1")  # fmt: skip


@CHEAP
@given(latin, some.integers(0, 10**12))
def test_any_range_header_is_parsed_or_refused(text: str, size: int) -> None:
    try:
        span = wanted(Headers({"range": text}), size, '"tag"')
    except RangeNotSatisfiable:
        return
    assert span is None or 0 <= span.start < span.stop <= size


@CHEAP
@given(some.integers(-5, 10**20), some.integers(-5, 10**20), some.integers(0, 1000))
def test_ranges_with_arbitrary_numbers_stay_within_the_file(first: int, last: int, size: int) -> None:
    try:
        span = wanted(Headers({"range": f"bytes={first}-{last}"}), size, '"tag"')
    except RangeNotSatisfiable:
        return
    assert span is None or 0 <= span.start < span.stop <= size


@CHEAP
@given(some.text(max_size=80), some.booleans())
def test_arbitrary_file_names_stay_within_their_header(name: str, attachment: bool) -> None:
    try:
        check_filename(name)
    except BadInput:
        return
    line = disposition(name, attachment)
    assert line.isascii() and not {"\r", "\n", "\0"} & set(line)
    assert line.count('"') == 2


@CHEAP
@given(some.text(max_size=120))
def test_blob_keys_cannot_leave_the_root(key: str) -> None:
    try:
        check_key(key)
    except BadInput:
        return
    root = Path("/blobs")
    assert (root / key).is_relative_to(root) and ".." not in key.split("/") and "\0" not in key


@CHEAP
@given(latin, latin, latin)
def test_arbitrary_upload_headers_are_parsed_or_refused(metadata: str, checksum: str, length: str) -> None:
    headers = Headers({"upload-checksum": checksum, "upload-length": length})
    for read in (
        lambda: filename(metadata),
        lambda: Checksum.of(headers),
        lambda: whole_number(headers, "Upload-Length"),
    ):
        try:
            found = read()
        except ImpastoError:
            continue
        assert not isinstance(found, int) or 0 <= found < 10**18
        assert not isinstance(found, str) or check_filename(found) == found


@CHEAP
@given(latin, some.lists(latin, max_size=4))
def test_arbitrary_key_headers_are_parsed_or_ignored(text: str, protocols: list[str]) -> None:
    assert _bearer(Headers({"authorization": text})) is None or text.lower().startswith("bearer ")
    found = _offered({"type": "websocket", "subprotocols": protocols})
    assert found is None or KEY_PROTOCOL + found in protocols
    assert _offered({"type": "http", "subprotocols": protocols}) is None


@CHEAP
@given(
    some.binary(max_size=200)
    | some.recursive(some.none() | some.floats(), some.lists, max_leaves=5).map(
        lambda value: json.dumps(value).encode()
    )
)
def test_json_is_strict(body: bytes) -> None:
    try:
        found = strict_json(body)
    except ImpastoError:
        return
    assert all(math.isfinite(number) for number in _numbers(found))


def _numbers(value: object) -> list[float]:
    if isinstance(value, list):
        return [number for item in value for number in _numbers(item)]
    return [value] if isinstance(value, float) else []


@pytest.mark.parametrize("depth", [65, 480, 950, 100_000])
def test_deeply_nested_json_is_refused(depth: int) -> None:
    with pytest.raises(ImpastoError, match="nests deeper than 64"):
        strict_json(b"[" * depth + b"]" * depth)


@pytest.mark.parametrize("body", [b"[" + b"[]," * 200_000 + b"[]]", b'{"a":' + b"[{}" + b",{}" * 300_000 + b"]}"])
def test_json_has_a_bounded_number_of_values(body: bytes) -> None:
    with pytest.raises(ImpastoError, match="more than 250000 values"):
        strict_json(body)
    assert strict_json(b'"' + b"[]," * 200_000 + b'"'), "text may contain anything"


def test_large_bodies_of_an_owner_take_turns() -> None:
    limits = classes(Settings())[Cost.BODY]
    anna, ben, cleo = (Principal(name, frozenset(Scope)) for name in ("anna", "ben", "cleo"))

    async def run() -> None:
        admission = Admission({Cost.BODY: replace(limits, wait_s=0.05)})
        async with admission.one(Cost.BODY, anna), admission.one(Cost.BODY, anna):
            with pytest.raises(Busy):
                async with admission.one(Cost.BODY, anna):
                    pass
            async with admission.one(Cost.BODY, ben), admission.one(Cost.BODY, ben):
                with pytest.raises(Busy):
                    async with admission.one(Cost.BODY, cleo):
                        pass
            async with admission.one(Cost.BODY, cleo):
                pass

    asyncio.run(run())


@CHEAP
@given(some.ip_addresses())
def test_internal_addresses_are_refused_in_every_notation(
    address: ipaddress.IPv4Address | ipaddress.IPv6Address,
) -> None:
    if not is_public(str(address)):
        return
    assert address.is_global and not address.is_loopback and not address.is_link_local and not address.is_multicast


@pytest.mark.parametrize("address", LOCAL + LOCAL_6)
def test_internal_webhook_targets_are_refused_by_address_and_name(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, 443))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_args, **_more: found)
    with pytest.raises(BadInput, match="private"):
        check_target("https://innocent.example/hook", private=False)
    check_target("https://innocent.example/hook", private=True)


@CHEAP
@given(some.text(max_size=80))
def test_arbitrary_text_is_a_valid_webhook_target_or_refused(url: str) -> None:
    try:
        check_target(url, private=True)
    except BadInput:
        return
    assert not url or url.lower().startswith(("http://", "https://"))


PNG = encode_png(tiny_frame(0))


@CHEAP
@given(some.binary(max_size=300), some.integers(0, len(PNG) - 1), some.binary(min_size=1, max_size=8))
def test_arbitrary_bytes_are_decoded_as_images_or_refused(noise: bytes, at: int, wrong: bytes) -> None:
    """Noise, or a real image with changed bytes, gives an image within the limits or our error."""
    changed = PNG[:at] + wrong + PNG[at + len(wrong) :]
    for data in (
        noise,
        b"\x89PNG\r\n\x1a\n" + noise,
        b"\xff\xd8\xff" + noise,
        b"RIFF" + noise,
        b"II*\0" + noise,
        changed,
    ):
        try:
            if form := image_format_of(io.BytesIO(data)):
                form.header(io.BytesIO(data))
            frame = decode_rgb(data, SMALL)
        except ImpastoError:
            continue
        assert frame.shape[0] * frame.shape[1] <= SMALL.pixels


@CHEAP
@given(names=some.lists(some.text(min_size=1, max_size=30), min_size=1, max_size=3), tail=some.binary(max_size=40))
def test_arbitrary_archives_are_opened_or_refused(
    names: list[str], tail: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("z") / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(zipfile.ZipInfo(name), PNG)
    path.write_bytes(path.read_bytes() + tail)
    try:
        opened, members = open_archive(path, SMALL)
    except ImpastoError:
        return
    with opened:
        for member in members:
            assert ".." not in member.filename.split("/") and not member.filename.startswith("/")
            assert len(read_entry(opened, member)) <= member.file_size


@CHEAP
@given(some.binary(max_size=100))
def test_arbitrary_array_files_are_read_or_refused(data: bytes) -> None:
    """`read_arrays` reads our own blobs only; even so it unpickles nothing."""
    for bytes_ in (data, b"\x93NUMPY" + data, b"PK\x03\x04" + data):
        with pytest.raises(Exception) as caught:
            read_arrays(bytes_)
        assert not isinstance(caught.value, SystemExit | MemoryError)


@CHEAP
@given(some.binary(max_size=60))
def test_arbitrary_messages_of_a_compromised_decoder_are_refused(data: bytes) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(struct.pack("!II", len(data), 0) + data)
        theirs.shutdown(socket.SHUT_WR)
        try:
            found, _ = receive(ours)
        except ConnectionBroken:
            return
        assert isinstance(found, dict)
