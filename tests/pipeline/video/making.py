"""Generates small videos with unusual properties."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.video.stills import encode_png

WIDTH, HEIGHT = 96, 64


def picture(index: int, width: int = WIDTH, height: int = HEIGHT) -> Frame:
    """A smooth image that differs for every index: its mean red level encodes the index."""
    frame = np.empty((height, width, 3), np.uint8)
    frame[..., 0] = 20 + 6 * (index % 36)
    frame[..., 1] = np.linspace(40, 200, width).astype(np.uint8)
    frame[..., 2] = np.linspace(60, 180, height).astype(np.uint8)[:, None]
    cv2.circle(frame, (10 + 3 * index % width, height // 2), 6, (250, 240, 60), -1)
    return frame


def make_video(
    path: Path,
    frames: Sequence[Frame],
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    pts: Sequence[int] | None = None,
    time_base: Fraction = Fraction(1, 25),
    options: dict[str, str] | None = None,
    rotation_ccw: int = 0,
    aspect: Fraction | None = None,
    tags: tuple[int, int] | None = None,
    click_s: Sequence[float] = (),
    audio_codec: str = "aac",
    audio_start_s: float = 0.0,
) -> Path:
    """Encode frames. `tags`: (matrix, range) as in the bitstream; `click_s`: times of clicks of sound."""
    with av.open(str(path), "w") as out:
        video = out.add_stream(codec, rate=25, options=options or {})
        height, width = frames[0].shape[:2]
        video.width, video.height, video.pix_fmt = width, height, pixel_format
        video.codec_context.time_base = time_base
        if aspect:
            video.codec_context.sample_aspect_ratio = aspect
        if rotation_ccw:
            video.set_display_rotation(rotation_ccw)
        if tags:
            video.codec_context.colorspace, video.codec_context.color_range = tags
        sound = out.add_stream(audio_codec, rate=48000, layout="mono") if click_s else None
        for number, frame in enumerate(frames):
            shown = av.VideoFrame.from_ndarray(frame, format="rgba" if frame.shape[2] == 4 else "rgb24")
            if tags:
                shown = shown.reformat(
                    format=pixel_format,
                    dst_colorspace={1: 1, 6: 5, 9: 9}[tags[0]],
                    src_color_range=2,
                    dst_color_range=tags[1],
                )
            shown.pts, shown.time_base = (pts[number] if pts else number), time_base
            out.mux(video.encode(shown))
        out.mux(video.encode(None))
        if sound:
            for packet in clicks(sound, click_s, len(frames) / 25 + 0.2, audio_start_s):
                out.mux(packet)
    return path


def clicks(stream: av.AudioStream, at_s: Sequence[float], seconds: float, start_s: float) -> list[av.Packet]:
    """Silence with loud 10 ms clicks at the given times, encoded; the first sample is at `start_s`."""
    rate, packets = 48000, []
    samples = np.zeros(int((seconds - start_s) * rate), np.int16)
    for at in at_s:
        begin = int((at - start_s) * rate)
        samples[begin : begin + rate // 100] = 20000
    for begin in range(0, len(samples), 1024):
        frame = av.AudioFrame.from_ndarray(samples[None, begin : begin + 1024], format="s16", layout="mono")
        frame.sample_rate, frame.time_base = rate, Fraction(1, rate)
        frame.pts = begin + int(start_s * rate)
        packets += stream.encode(frame)
    return packets + stream.encode(None)


def heard_clicks(path: Path) -> list[float]:
    """Times (s) at which sound rises from silence."""
    times, level, quiet = [], [], 0
    with av.open(str(path)) as source:
        for frame in source.decode(audio=0):
            values = np.abs(frame.to_ndarray().astype(np.float64)).max(axis=0)
            times.append(float(frame.pts * frame.time_base) + np.arange(frame.samples) / frame.sample_rate)
            level.append(values[: frame.samples] if values.size >= frame.samples else values)
    time, loud = np.concatenate(times), np.concatenate(level)
    loud = loud > 0.3 * loud.max()
    found: list[float] = []
    for at in time[loud]:
        if at - quiet > 0.05 or not found:
            found.append(float(at))
        quiet = at
    return found


def make_zip(path: Path, entries: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def png_frames(count: int, width: int = WIDTH, height: int = HEIGHT) -> dict[str, bytes]:
    return {f"frame_{index}.png": encode_png(picture(index, width, height)) for index in range(count)}
