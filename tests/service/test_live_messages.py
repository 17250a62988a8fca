"""Headers and messages of the live protocol: valid ones round-trip, invalid ones are refused."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import BadInput, ImpastoError
from service.errors import TABLE, BadMessage
from service.live.closing import _CODES, close_code, shown
from service.live.frames import Header, pack, unpack
from service.live.messages import ByeIn, Hello, KeyframeIn, ParamsIn, parse
from tests.service.live_client import pack as pack_bytes

U16, U32, U64 = st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)


@given(st.booleans(), U16, U16, U32, U64, st.binary(min_size=1, max_size=99))
def test_a_request_frame_round_trips(
    key: bool, width: int, height: int, sequence: int, timestamp: int, payload: bytes
) -> None:
    header, data = unpack(pack_bytes(sequence, (width, height), payload, key, timestamp))
    assert header == Header(key, width, height, sequence, timestamp)
    assert data == payload


def test_an_answer_frame_has_the_documented_bytes() -> None:
    made = pack(Header(True, 640, 480, 7, 2**40, 16_300), b"data")
    assert made.hex(" ", 4) == "01010280 01e00000 00000007 00003fac 00000100 00000000 00000000 00000000 64617461"


@given(st.binary(max_size=60))
def test_arbitrary_bytes_are_a_frame_or_a_bad_message(data: bytes) -> None:
    try:
        unpack(data)
    except BadMessage as error:
        assert error.field.startswith("frame")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ('{"type": "hello", "width": 64, "height": 64}', Hello),
        ('{"type": "hello", "width": 64, "height": 64, "fps": 25, "send": ["vp8"], "params": {"a": 1}}', Hello),
        ('{"type": "params", "params": {"lines": "off"}, "inputs": {"reference": null}}', ParamsIn),
        ('{"type": "keyframe"}', KeyframeIn),
        ('{"type": "bye"}', ByeIn),
    ],
)
def test_valid_messages_are_parsed(text: str, kind: type) -> None:
    assert isinstance(parse(text), kind)


@pytest.mark.parametrize(
    "text", ["", "no json", "[]", "3", "{}", '{"type": "cat"}', '{"type": 3}', '{"type": "bye", "a": NaN}', "[" * 99999]
)
def test_invalid_messages_are_refused(text: str) -> None:
    with pytest.raises(BadMessage) as raised:
        parse(text)
    assert raised.value.remedy
    assert close_code(raised.value) == 4400


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("width", "640"), ("width", 1.5), ("fps", "30"), ("quality", 0), ("quality", 101), ("seed", -1), ("send", []),
        ("send", "jpeg"), ("send", ["x"] * 17), ("prefer", "fast"), ("filter", 3), ("params", []),
        ("inputs", {"reference": 3}), ("cat", 1),
    ],
)  # fmt: skip
def test_the_error_names_the_bad_message_field(field: str, value: Any) -> None:
    hello = {"type": "hello", "width": 64, "height": 64, field: value}
    with pytest.raises(BadInput) as raised:
        parse(json.dumps(hello))
    assert raised.value.field.startswith(field)
    assert raised.value.remedy
    assert close_code(raised.value) == 4400


@given(st.text(max_size=40) | st.from_regex(r'\{"type": "(hello|params|bye)", "[a-z]+": [0-9\[\]{}"]+\}'))
def test_arbitrary_text_is_a_message_or_a_typed_error(text: str) -> None:
    try:
        parse(text)
    except (BadMessage, BadInput) as error:
        assert close_code(error) == 4400


def test_every_close_reason_has_a_title() -> None:
    assert set(_CODES) <= set(TABLE)


def test_internal_errors_are_reported_without_their_messages() -> None:
    for fault in (RuntimeError("secret"), ImpastoError("secret")):
        raised = shown(fault)
        assert "secret" not in str(raised)
        assert close_code(raised) == 1011
