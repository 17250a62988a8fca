"""Frames to bytes and back, without delay: one payload in, one frame out.

Still codecs (JPEG, WebP, raw) encode each frame independently. Video codecs (H.264, VP8) are configured without delay:
no reordering, no look-ahead, one thread. Colour is converted as in `pipeline.video`: BT.709 from 720 lines up, BT.601
below, with tags; VP8 is always BT.601.
"""

from __future__ import annotations

import io
from fractions import Fraction
from typing import Protocol

import av
import cv2
import numpy as np
from av.codec.codec import Codec
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

from pipeline.errors import BadFrame, ImpastoError
from pipeline.formats import image_format
from pipeline.frames import Frame
from pipeline.video.geometry import Geometry, customary_matrix, to_frame
from pipeline.video.pixel_formats import YuvConverter
from workers.live.model import Size, WireFormat

BUILT_ON = frozenset({"h264", "vp8"})
"""Codecs whose frames depend on earlier ones."""
CODECS = ("h264", "vp8", "jpeg", "webp", "raw")
"""Every codec, for receiving and sending."""
KEY_EVERY_S = 3
_BT601_TAG = 6
_LOW_DELAY = 0x00080000


class Decoder(Protocol):
    def decode(self, payload: bytes, size: Size) -> Frame:
        """The frame of a payload whose header says `size`. Raises BadFrame."""
        ...


class Encoder(Protocol):
    def encode(self, frame: Frame, key: bool) -> tuple[bytes, Size, bool]:
        """(payload, (width, height) of its picture, whether it is a key frame). All frames have one size."""
        ...


def decoder(codec: str, max_side_px: int) -> Decoder:
    """A decoder of `codec`, one of CODECS, for pictures of at most `max_side_px` a side."""
    if codec == "raw":
        return _RawDecoder()
    return _VideoDecoder(codec, max_side_px) if codec in BUILT_ON else _StillDecoder(codec)


def encoder(wire: WireFormat, size: Size) -> Encoder:
    """An encoder of `wire.receive` for frames of `size`."""
    if wire.receive == "raw":
        return _RawEncoder()
    return _VideoEncoder(wire, size) if wire.receive in BUILT_ON else _StillEncoder(wire)


def webcodecs_name(codec: str, size: Size, fps: float) -> str | None:
    """Codec string of WebCodecs for the stream, with a level that covers all sizes up to `size`; None for codecs that
    WebCodecs lacks."""
    if codec == "vp8":
        return "vp8"
    if codec != "h264":
        return None
    blocks = -(-size[0] // 16) * -(-size[1] // 16)
    level = next((name for name, most, rate in _LEVELS if blocks <= most and blocks * fps <= rate), 52)
    return f"avc1.42E0{level:02X}"


_LEVELS = (
    (31, 3600, 108_000), (40, 8192, 245_760), (42, 8704, 522_240), (50, 22_080, 589_824), (51, 36_864, 983_040),
)  # fmt: skip
"""H.264 levels times ten: macroblocks a frame and a second (ITU-T H.264, table A-1)."""


def video_context(codec: str, max_side_px: int) -> VideoCodecContext:
    """FFmpeg's own decoder of `codec`, one of BUILT_ON. It reads the size of a picture from the header, and refuses one
    of more than `max_side_px`**2 pixels before it allocates memory; libvpx would not."""
    context = Codec(codec, "r").create()
    assert isinstance(context, VideoCodecContext)
    context.thread_count, context.thread_type = 1, "NONE"
    context.flags |= _LOW_DELAY
    context.options = {"max_pixels": str((max_side_px + 64) ** 2)}
    return context


class _RawDecoder:
    def decode(self, payload: bytes, size: Size) -> Frame:
        width, height = size
        if len(payload) != width * height * 3:
            raise BadFrame(
                "A raw frame has three bytes for each pixel of its header.",
                field="payload", value=f"{len(payload)} bytes for {width}x{height}", remedy="Send RGB without padding.",
            )  # fmt: skip
        return np.frombuffer(payload, np.uint8).reshape(height, width, 3)


class _RawEncoder:
    def encode(self, frame: Frame, key: bool) -> tuple[bytes, Size, bool]:
        return frame.tobytes(), (frame.shape[1], frame.shape[0]), True


class _StillDecoder:
    def __init__(self, codec: str) -> None:
        self._codec = codec

    def decode(self, payload: bytes, size: Size) -> Frame:
        self._check(payload, size)
        flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        picture = cv2.imdecode(np.frombuffer(payload, np.uint8), flags)
        if picture is None:
            raise _undecodable(self._codec)
        return np.asarray(picture, np.uint8)

    def _check(self, payload: bytes, size: Size) -> None:
        """Check the size in the header before memory of that size is allocated."""
        try:
            form = image_format(payload[:4096])
            codec = form.name if form else "something else"
            header = form.header(io.BytesIO(payload)) if form and codec == self._codec else None
        except ImpastoError:
            header, codec = None, "not a picture"
        if header is None:
            raise BadFrame(f"A frame must be one {self._codec} picture.", field="payload", value=codec)
        _same_size((header.width, header.height), size)
        if self._codec == "jpeg" and payload.rfind(b"\xff\xd9", max(0, len(payload) - 1024)) < 0:
            raise _undecodable(self._codec)


class _StillEncoder:
    def __init__(self, wire: WireFormat) -> None:
        jpeg = wire.receive == "jpeg"
        self._suffix = ".jpg" if jpeg else ".webp"
        self._options = [cv2.IMWRITE_JPEG_QUALITY if jpeg else cv2.IMWRITE_WEBP_QUALITY, wire.quality]

    def encode(self, frame: Frame, key: bool) -> tuple[bytes, Size, bool]:
        _, data = cv2.imencode(self._suffix, cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), self._options)
        return data.tobytes(), (frame.shape[1], frame.shape[0]), True


class _VideoDecoder:
    def __init__(self, codec: str, max_side_px: int) -> None:
        self._codec, self._context = codec, video_context(codec, max_side_px)

    def decode(self, payload: bytes, size: Size) -> Frame:
        try:
            pictures = self._context.decode(av.Packet(payload))
        except (av.FFmpegError, ValueError):
            raise _undecodable(self._codec) from None
        if len(pictures) != 1 or pictures[0].is_corrupt:
            raise _undecodable(self._codec)
        picture = pictures[0]
        stored = (picture.width, picture.height)
        if stored != size:  # an odd side is extended by one row or column
            _same_size(stored, (size[0] + size[0] % 2, size[1] + size[1] % 2))
        frame = to_frame(picture, Geometry(stored))
        return np.ascontiguousarray(frame[: size[1], : size[0]])


class _VideoEncoder:
    def __init__(self, wire: WireFormat, size: Size) -> None:
        self._size = (size[0] + size[0] % 2, size[1] + size[1] % 2)
        matrix = customary_matrix(size[1]) if wire.receive == "h264" else Colorspace.ITU601  # VP8 has no other
        self._to_yuv = YuvConverter(matrix)
        name, options = _h264(wire) if wire.receive == "h264" else _vp8(wire)
        context = Codec(name, "w").create()
        assert isinstance(context, VideoCodecContext)
        context.options = options | {"g": str(max(1, round(KEY_EVERY_S * wire.fps)))}
        _describe(context, self._size, wire.fps, matrix)
        self._context, self._next = context, 0

    def encode(self, frame: Frame, key: bool) -> tuple[bytes, Size, bool]:
        right, bottom = self._size[0] - frame.shape[1], self._size[1] - frame.shape[0]
        if right or bottom:
            frame = np.asarray(cv2.copyMakeBorder(frame, 0, bottom, 0, right, cv2.BORDER_REPLICATE), np.uint8)
        picture = self._to_yuv(frame)
        picture.pts, picture.time_base = self._next, self._context.time_base
        picture.pict_type = PictureType.I if key else PictureType.NONE
        self._next += 1
        (packet,) = self._context.encode(picture)
        return bytes(packet), self._size, packet.is_keyframe


def _h264(wire: WireFormat) -> tuple[str, dict[str, str]]:
    """Constrained baseline: every browser and phone decodes it in hardware."""
    crf = round(50 - 0.32 * wire.quality)
    tuning = {"preset": "superfast", "tune": "zerolatency", "profile": "baseline", "forced-idr": "1"}
    return "libx264", tuning | {"crf": str(crf), "x264-params": "scenecut=0:repeat-headers=1:annexb=1"}


def _vp8(wire: WireFormat) -> tuple[str, dict[str, str]]:
    quantizer = round(58 - 0.5 * wire.quality)
    speed = {"deadline": "realtime", "cpu-used": "8", "lag-in-frames": "0", "auto-alt-ref": "0"}
    return "libvpx", speed | {"b": "50000000", "qmin": str(quantizer), "qmax": str(min(63, quantizer + 6))}


def _describe(context: VideoCodecContext, size: Size, fps: float, matrix: Colorspace) -> None:
    context.width, context.height = size
    context.pix_fmt = "yuv420p"
    rate = max(Fraction(fps).limit_denominator(1001), Fraction(1, 1001))
    context.framerate, context.time_base = rate, 1 / rate
    context.thread_count = 1
    hd = matrix == Colorspace.ITU709
    context.color_range = ColorRange.MPEG
    context.colorspace = Colorspace.ITU709 if hd else _BT601_TAG
    context.color_primaries = ColorPrimaries.BT709 if hd else ColorPrimaries.SMPTE170M
    context.color_trc = ColorTrc.BT709 if hd else ColorTrc.SMPTE170M


def _same_size(found: Size, announced: Size) -> None:
    if found != announced:
        raise BadFrame(
            "The size of the picture differs from its header.",
            field="payload", value=f"{found[0]}x{found[1]} instead of {announced[0]}x{announced[1]}",
            remedy="Put the picture's width and height into the header.",
        )  # fmt: skip


def _undecodable(codec: str) -> BadFrame:
    return BadFrame(
        f"The payload cannot be decoded as {codec}.", field="payload",
        remedy="Send whole frames of the agreed codec, beginning with a key frame.",
    )  # fmt: skip
