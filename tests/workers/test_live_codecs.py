"""Encoding and decoding of live frames: no delay, correct colours, and refusal of invalid data."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pipeline.scenes
from pipeline.errors import BadFrame
from pipeline.frames import Frame
from workers.live.codecs import BUILT_ON, CODECS, decoder, encoder, webcodecs_name
from workers.live.model import Size, WireFormat

SIZE = (160, 96)
ODD = (161, 97)
VIDEO = sorted(BUILT_ON)


@cache
def frames(size: Size = SIZE, count: int = 12) -> list[Frame]:
    scene = pipeline.scenes.scene("harbour", size, frames=count)
    return [scene.image(index) for index in range(count)]


def wire(codec: str, quality: int = 85, fps: float = 30) -> WireFormat:
    return WireFormat(codec, codec, quality, fps)


@pytest.mark.parametrize("size", [SIZE, ODD])
@pytest.mark.parametrize("codec", CODECS)
def test_every_codec_returns_one_similar_picture_per_frame(codec: str, size: Size) -> None:
    there, back = encoder(wire(codec), size), decoder(codec, 1920)
    for index, frame in enumerate(frames(size)):
        payload, coded, key = there.encode(frame, key=False)
        assert key == (index == 0 or codec not in BUILT_ON)
        assert coded == (size if codec not in BUILT_ON else (size[0] + size[0] % 2, size[1] + size[1] % 2))
        decoded = back.decode(payload, size)
        assert decoded.shape == frame.shape
        assert decoded.flags.c_contiguous
        assert cv2.PSNR(decoded, frame) > (100 if codec == "raw" else 29)


@pytest.mark.parametrize("codec", [c for c in CODECS if c != "raw"])
@pytest.mark.parametrize("height", [96, 720])
def test_codecs_preserve_colours(codec: str, height: int) -> None:
    """Wrong matrices or ranges change flat colours; 720 lines are BT.709."""
    frame = np.empty((height, 192, 3), np.uint8)
    colours = [(200, 40, 40), (40, 190, 60), (50, 60, 210), (16, 16, 16), (240, 240, 240), (128, 128, 128)]
    for column, colour in enumerate(colours):
        frame[:, 32 * column : 32 * column + 32] = colour
    payload, _, _ = encoder(wire(codec, 95), (192, height)).encode(frame, key=True)
    decoded = decoder(codec, 1920).decode(payload, (192, height))
    for column, colour in enumerate(colours):
        assert np.abs(decoded[height // 2, 32 * column + 16].astype(int) - colour).max() <= 6


@pytest.mark.parametrize("codec", VIDEO)
def test_key_frames_are_sent_on_request_and_periodically(codec: str) -> None:
    there = encoder(wire(codec, fps=2), SIZE)
    keys = [there.encode(frame, key=index == 4)[2] for index, frame in enumerate(frames())]
    assert [index for index, key in enumerate(keys) if key] == [0, 4, 10]


@pytest.mark.parametrize("codec", VIDEO)
def test_decoding_can_begin_at_any_key_frame(codec: str) -> None:
    there = encoder(wire(codec), SIZE)
    payloads = [there.encode(frame, key=index == 5)[0] for index, frame in enumerate(frames())]
    back = decoder(codec, 1920)
    decoded = [back.decode(payload, SIZE) for payload in payloads[5:]]
    assert cv2.PSNR(decoded[-1], frames()[-1]) > 29


def test_h264_is_annex_b_with_parameter_sets_at_each_key_frame() -> None:
    there = encoder(wire("h264"), SIZE)
    for index, frame in enumerate(frames()):
        payload, _, key = there.encode(frame, key=index == 5)
        kinds = [part[0] & 31 for part in payload.split(b"\x00\x00\x01")[1:]]
        assert payload.startswith(b"\x00\x00\x00\x01")
        assert ({7, 8, 5} <= set(kinds)) == key


def test_higher_quality_needs_more_bytes() -> None:
    for codec in ("jpeg", "webp", *VIDEO):
        sizes = [len(encoder(wire(codec, quality), SIZE).encode(frames()[0], True)[0]) for quality in (10, 50, 95)]
        assert sizes == sorted(sizes), codec
        assert sizes[-1] > 1.5 * sizes[0], codec


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("payload", [b"garbage", b"\xff\xd8\xff" + bytes(50), bytes(4000), b"\x00\x00\x00\x01g" * 9])
def test_undecodable_data_is_refused(codec: str, payload: bytes) -> None:
    with pytest.raises(BadFrame) as raised:
        decoder(codec, 1920).decode(payload, SIZE)
    assert raised.value.field == "payload"


@pytest.mark.parametrize("codec", VIDEO)
def test_a_stream_that_does_not_begin_with_a_key_frame_is_refused(codec: str) -> None:
    there = encoder(wire(codec), SIZE)
    payloads = [there.encode(frame, key=False)[0] for frame in frames()]
    with pytest.raises(BadFrame):
        decoder(codec, 1920).decode(payloads[3], SIZE)


@pytest.mark.parametrize("codec", CODECS)
def test_the_header_must_state_the_frame_size(codec: str) -> None:
    payload, _, _ = encoder(wire(codec), SIZE).encode(frames()[0], True)
    with pytest.raises(BadFrame):
        decoder(codec, 1920).decode(payload, (SIZE[0] * 2, SIZE[1]))


def test_a_truncated_picture_is_refused() -> None:
    payload, _, _ = encoder(wire("jpeg"), SIZE).encode(frames()[0], True)
    with pytest.raises(BadFrame):
        decoder("jpeg", 1920).decode(payload[: len(payload) // 2], SIZE)


def test_a_picture_larger_than_the_limit_is_not_decoded() -> None:
    large = np.zeros((512, 2048, 3), np.uint8)
    for codec in VIDEO:
        payload, _, _ = encoder(wire(codec), (2048, 512)).encode(large, True)
        with pytest.raises(BadFrame):
            decoder(codec, 256).decode(payload, (2048, 512))


def test_webcodecs_names_of_codecs() -> None:
    assert webcodecs_name("h264", (640, 480), 30) == "avc1.42E01F"
    assert webcodecs_name("h264", (1920, 1080), 30) == "avc1.42E028"
    assert webcodecs_name("h264", (1920, 1080), 60) == "avc1.42E02A"
    assert webcodecs_name("vp8", (640, 480), 30) == "vp8"
    assert webcodecs_name("jpeg", (640, 480), 30) is None
