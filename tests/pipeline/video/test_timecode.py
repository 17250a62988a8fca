"""Films for editing keep the timecode of the first frame, every sound track, and the exact frame rate.

Checked by hand with ffprobe, too; here FFmpeg's demuxers read the same tags through PyAV."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.formats.base import Encoding
from pipeline.video.join import join
from pipeline.video.writer import SegmentSpec, segment_writer

SIZE = (320, 180)
RATES = {"25": "10:00:00:00", "24000/1001": "01:02:03:04", "30000/1001": "00:59:59;28"}
"""Timecode of a rate; with a semicolon, it drops frame numbers."""


def camera_original(path: Path, rate: Fraction, timecode: str) -> Path:
    """A second of QuickTime with a timecode and two mono tracks."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", rate=rate)
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        video.metadata["timecode"] = timecode
        tracks = [out.add_stream("pcm_s16le", rate=48000, layout="mono") for _ in range(2)]
        for index in range(int(rate)):
            out.mux(video.encode(av.VideoFrame.from_ndarray(np.full((SIZE[1], SIZE[0], 3), index, np.uint8))))
        out.mux(video.encode(None))
        for number, track in enumerate(tracks):
            samples = av.AudioFrame.from_ndarray(np.full((1, 48000), 1000 * number, np.int16), "s16", "mono")
            samples.sample_rate = 48000
            out.mux(track.encode(samples))
            out.mux(track.encode(None))
    return path


@pytest.mark.parametrize("rate", list(RATES))
@pytest.mark.parametrize(("form", "profile"), [
    ("mov", "422hq"), ("mov", "dnxhr-hqx"), ("mkv", "ffv1"), ("mkv", "422hq"), ("mkv", "hevc"), ("mxf", "dnxhr-hqx"),
    ("mxf", "422hq"),
])  # fmt: skip
def test_timecode_tracks_and_rate_are_kept(form: str, profile: str, rate: str, tmp_path: Path) -> None:
    fps = Fraction(rate)
    source = camera_original(tmp_path / "in.mov", fps, RATES[rate])
    with segment_writer(tmp_path / "segment", SegmentSpec(form, SIZE, 1 / fps, float(fps), 20, profile)) as writer:
        for index in range(int(fps)):
            writer.write(index, np.full((SIZE[1], SIZE[0], 3), 8 * index, np.uint8), index, index + 1)
    out = tmp_path / f"out.{form}"
    assert join([(Fraction(0), tmp_path / "segment")], out, Encoding(form), source) == ()
    with av.open(str(out)) as made:
        tags = [made.metadata, *(stream.metadata for stream in made.streams)]
        found = {value for each in tags for name, value in each.items() if name.lower() == "timecode"}
        assert found == {RATES[rate]}
        assert len(made.streams.audio) == 2 and {track.sample_rate for track in made.streams.audio} == {48000}
        assert made.streams.video[0].guessed_rate == fps
