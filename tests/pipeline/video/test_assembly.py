"""Films of shots joined in one file: pictures unchanged, sound in step, other sizes fitted."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.video.assembly import assemble, fitted
from pipeline.video.join import join
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer

RATE, FPS = 48000, 12


def make_film(
    path: Path,
    shade: int,
    frames: int,
    tone_hz: float = 0,
    size: tuple[int, int] = (64, 48),
    sound_s: float | None = None,
) -> Path:
    """A film of one shade with a tone; `sound_s`: how long it lasts, as long as the pictures if not given."""
    spec = SegmentSpec("mp4", size, Fraction(1, FPS), FPS)
    segment, sound = path.with_suffix(".segment"), path.with_suffix(".wav")
    with segment_writer(segment, spec) as writer:
        for index in range(frames):
            picture = np.full((size[1], size[0], 3), shade, np.uint8)
            picture[: 4 + index] = 255 - shade
            writer.write(index, picture, index, index + 1)
    if tone_hz:
        samples = round((frames / FPS if sound_s is None else sound_s) * RATE)
        wave = (8000 * np.sin(2 * np.pi * tone_hz * np.arange(samples) / RATE)).astype(np.int16)
        with av.open(str(sound), "w") as out:
            stream = out.add_stream("pcm_s16le", rate=RATE, layout="mono")
            frame = av.AudioFrame.from_ndarray(wave[None], format="s16", layout="mono")
            frame.sample_rate = RATE
            out.mux(stream.encode(frame))
            out.mux(stream.encode(None))
    join([(Fraction(0), segment)], path, "mp4", sound if tone_hz else None)
    return path


def pictures(path: Path) -> list[Frame]:
    with VideoReader(path) as reader:
        return list(reader.read(0, len(reader.index.pts)))


def sound(path: Path) -> np.ndarray:
    """The first channel, -1..1, from time 0."""
    with av.open(str(path)) as source:
        frames = [frame for frame in source.decode(audio=0) if frame.pts is not None and frame.pts >= 0]
    return np.concatenate([frame.to_ndarray()[0] for frame in frames])


def tone_of(samples: np.ndarray) -> float:
    """The strongest frequency, Hz; 0 for silence."""
    if np.abs(samples).max() < 0.02:
        return 0.0
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples))))
    return float(np.fft.rfftfreq(len(samples), 1 / RATE)[spectrum.argmax()])


def test_pictures_of_films_that_are_encoded_alike_are_copied(tmp_path: Path) -> None:
    films = [make_film(tmp_path / f"{shade}.mp4", shade, frames) for shade, frames in ((40, 5), (200, 9))]
    out = tmp_path / "film.mp4"
    assemble(films, out, "mp4")
    expected = [*pictures(films[0]), *pictures(films[1])]
    assert len(pictures(out)) == 14
    assert all(np.array_equal(a, b) for a, b in zip(pictures(out), expected, strict=True))
    with VideoReader(out) as reader:
        assert [float(reader.index.time(k) * reader.index.time_base) for k in (0, 5, 13)] == pytest.approx(
            [0, 5 / FPS, 13 / FPS]
        )
        assert reader.index.duration_s == pytest.approx(14 / FPS)


def test_sound_stays_in_step_with_the_shots(tmp_path: Path) -> None:
    """A tone of its own for each shot; one is silent, one has too little sound, and one too much."""
    films = [
        make_film(tmp_path / "a.mp4", 40, 12, 440),
        make_film(tmp_path / "b.mp4", 90, 12),
        make_film(tmp_path / "c.mp4", 140, 24, 880, sound_s=1.0),
        make_film(tmp_path / "d.mp4", 190, 6, 1320),
        make_film(tmp_path / "e.mp4", 240, 12, 660),
    ]
    out = tmp_path / "film.mp4"
    assemble(films, out, "mp4")
    heard = sound(out)
    starts = np.cumsum([0, 12, 12, 24, 6]) / FPS
    tones = [tone_of(heard[round((at + 0.1) * RATE) : round((at + 0.4) * RATE)]) for at in starts]
    assert tones == pytest.approx([440, 0, 880, 1320, 660], abs=4)
    assert tone_of(heard[round(3.3 * RATE) : round(3.8 * RATE)]) == 0
    loud = np.abs(heard) > 0.05
    for at in (starts[1], starts[2], starts[3]):  # where sound ends or begins beside silence
        edges = np.flatnonzero(np.diff(loud[round((at - 0.02) * RATE) : round((at + 0.02) * RATE)].astype(int)))
        assert np.abs(edges / RATE - 0.02).min() < 0.004, "within 4 ms"


def test_a_film_of_another_size_is_fitted_into_that_of_the_first(tmp_path: Path) -> None:
    films = [make_film(tmp_path / "a.mp4", 40, 4), make_film(tmp_path / "b.mp4", 200, 6, 440, (96, 48))]
    out = tmp_path / "film.mp4"
    assemble(films, out, "mp4", quality=8)
    found = pictures(out)
    assert [frame.shape for frame in found] == [(48, 64, 3)] * 10
    assert found[5][2].max() < 20 and found[5][45].max() < 20, "black above and below"
    assert found[9][36].mean() == pytest.approx(200, abs=6)
    assert tone_of(sound(out)[round(0.4 * RATE) : round(0.7 * RATE)]) == pytest.approx(440, abs=4)


def test_the_same_films_give_the_same_bytes(tmp_path: Path) -> None:
    films = [make_film(tmp_path / "a.mp4", 40, 4, 440), make_film(tmp_path / "b.mp4", 200, 6, 550, (32, 48))]
    for name in ("one.mp4", "two.mp4"):
        assemble(films, tmp_path / name, "mp4")
    assert (tmp_path / "one.mp4").read_bytes() == (tmp_path / "two.mp4").read_bytes()


def test_a_frame_is_fitted_without_changing_its_proportions() -> None:
    wide = np.full((10, 40, 3), 200, np.uint8)
    found = fitted(wide, (20, 20))
    rows = np.flatnonzero(found.max((1, 2)))
    assert (rows[0], rows[-1]) == (7, 11)
    assert fitted(wide, (40, 10)) is wide
