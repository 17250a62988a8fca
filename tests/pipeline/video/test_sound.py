"""Sound keeps its times through holes, changes of format and joins; everything else that a film carries goes along."""

from __future__ import annotations

import io
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.subtitles.subtitle import SubtitleSet

from pipeline.errors import BadParameter
from pipeline.video import audio
from pipeline.video.audio import tracks_of
from pipeline.video.media import SourceOptions
from tests.pipeline.video.films import MARKS_S, RATE, click_times, film, flash_times, joined, painted, samples


def sound_of(path: Path) -> list[tuple[str, int, str]]:
    """Codec, channels and language of each track."""
    with av.open(str(path)) as source:
        return [
            (s.codec_context.codec.canonical_name, s.codec_context.layout.nb_channels, s.language or "und")
            for s in source.streams.audio
        ]


def assert_heard(source: Path, out: Path, at_s: list[float], container: str = "mp4", track: int = 0) -> None:
    painted(source, out, container)
    seen, heard = flash_times(out), click_times(out, track)
    assert seen == pytest.approx(MARKS_S, abs=0.025)
    assert heard == pytest.approx([seen[MARKS_S.index(mark)] for mark in at_s], abs=0.02)


# -- holes

HOLES = {
    "opus in mkv": ("h.mkv", "libopus", [(0.68, 0.95)]),
    "pcm in mkv": ("h.mkv", "pcm_s16le", [(0.68, 0.95)]),
    "two holes": ("h.mkv", "flac", [(0.3, 0.5), (1.1, 1.3)]),
    "aac in mkv": ("h.mkv", "aac", [(0.68, 0.95)]),
    "aac in ts": ("h.ts", "aac", [(2.1, 2.35)]),
    "mp2 in mpg": ("h.mpg", "mp2", [(1.2, 1.45)]),
    "many short holes": ("h.mkv", "pcm_s16le", [(0.3 + 0.1 * n, 0.33 + 0.1 * n) for n in range(10)]),
    "a hole at the beginning": ("h.mkv", "libopus", [(-1, 0.15)]),
}


@pytest.mark.parametrize("container", ["mp4", "webm"])
@pytest.mark.parametrize("which", HOLES)
def test_sound_after_a_hole_stays_where_it_was(which: str, container: str, tmp_path: Path) -> None:
    name, codec, holes = HOLES[which]
    lead = 1.4 if name.endswith("ts") else 0.5 if name.endswith("mpg") else 0.0
    path = film(
        tmp_path / name, "mpeg1video" if name.endswith("mpg") else "libx264", codec, options={"g": "10", "bf": "0"},
        keeps=lambda time_s: not any(start - lead < time_s < stop - lead for start, stop in holes),
    )  # fmt: skip
    out = tmp_path / f"out.{container}"
    assert_heard(path, out, MARKS_S, container)
    with av.open(str(out)) as made:
        pieces = [(float(p.pts * p.time_base), p.samples / p.sample_rate) for p in made.decode(audio=0)]
    assert all(abs(b[0] - a[0] - a[1]) < 0.005 for a, b in pairwise(pieces)), "no hole is left"


# -- changes

CHANGES: dict[str, tuple[tuple[str, str, int], tuple[str, str, int]]] = {
    "stereo, then 5.1": (("ac3", "stereo", 48000), ("ac3", "5.1", 48000)),
    "5.1, then stereo": (("ac3", "5.1", 48000), ("ac3", "stereo", 48000)),
    "another rate": (("mp2", "stereo", 48000), ("mp2", "stereo", 44100)),
    "mono, then stereo at another rate": (("mp2", "mono", 44100), ("mp2", "stereo", 48000)),
    "aac, mono then stereo": (("aac", "mono", 48000), ("aac", "stereo", 48000)),
}


@pytest.mark.parametrize("container", ["mp4", "webm"])
@pytest.mark.parametrize("which", CHANGES)
def test_a_change_of_the_sound_in_the_middle_is_survived(which: str, container: str, tmp_path: Path) -> None:
    parts = []
    for number, (codec, layout, rate) in enumerate(CHANGES[which]):
        frames = range(20) if number == 0 else range(20, 40)
        parts.append(
            film(tmp_path / f"{number}.ts", sound=codec, frames=frames, offset_s=0.8 * number, layout=layout, rate=rate,
                 options={"g": "10", "bf": "0"})
        )  # fmt: skip
    assert_heard(joined(tmp_path / "j.ts", *parts), tmp_path / f"out.{container}", MARKS_S, container)


# -- tracks


def with_tracks(path: Path, tracks: list[tuple[str, str, str, float]]) -> Path:
    """A film with a click in each sound track, of (codec, language, title, time of the click in s)."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", rate=25, options={"bf": "0"})
        video.width, video.height, video.pix_fmt = 96, 64, "yuv420p"
        made: list[tuple[Any, float]] = []
        for codec, language, title, click_s in tracks:
            stream = out.add_stream(codec, rate=RATE, layout="mono")
            stream.metadata.update({"language": language, "title": title})
            made.append((stream, click_s))
        for at in range(25):
            picture = av.VideoFrame.from_ndarray(np.full((64, 96, 3), 40, np.uint8))
            picture.pts, picture.time_base = at, Fraction(1, 25)
            out.mux(video.encode(picture))
        out.mux(video.encode(None))
        for stream, click_s in made:
            out.mux(samples(stream, [click_s], 1.0, RATE, "mono"))
    return path


def test_all_tracks_go_along_with_their_languages_and_titles(tmp_path: Path) -> None:
    tracks = [("aac", "eng", "Original", 0.2), ("libmp3lame", "deu", "Deutsch", 0.4), ("flac", "fra", "", 0.6)]
    path = with_tracks(tmp_path / "t.mkv", tracks)
    painted(path, tmp_path / "out.mp4")
    assert sound_of(tmp_path / "out.mp4") == [("aac", 1, "eng"), ("mp3", 1, "deu"), ("aac", 1, "fra")]
    for track, (_codec, _language, _title, click_s) in enumerate(tracks):
        assert click_times(tmp_path / "out.mp4", track) == pytest.approx([click_s], abs=0.02)
    painted(path, tmp_path / "out.webm", "webm")
    assert [language for _codec, _channels, language in sound_of(tmp_path / "out.webm")] == ["eng", "deu", "fra"]
    with av.open(str(tmp_path / "out.webm")) as made:
        assert [s.metadata.get("title") for s in made.streams.audio] == ["Original", "Deutsch", None]


def test_a_sound_track_is_chosen(tmp_path: Path) -> None:
    path = with_tracks(tmp_path / "t.mkv", [("aac", "eng", "", 0.2), ("aac", "deu", "", 0.6)])
    painted(path, tmp_path / "out.mp4", options=SourceOptions(sound=(1,)))
    assert sound_of(tmp_path / "out.mp4") == [("aac", 1, "deu")]
    assert click_times(tmp_path / "out.mp4") == pytest.approx([0.6], abs=0.02)
    with pytest.raises(BadParameter, match="2 sound tracks"):
        painted(path, tmp_path / "no.mp4", options=SourceOptions(sound=(2,)))


@pytest.mark.parametrize(("layout", "kept"), [("5.1", 6), ("7.1", 8), ("4.0", 2), ("stereo", 2), ("mono", 1)])
@pytest.mark.parametrize("container", ["mp4", "webm"])
def test_channels_are_kept_where_the_encoder_has_them(layout: str, kept: int, container: str, tmp_path: Path) -> None:
    path = film(tmp_path / "c.mkv", sound="flac", layout=layout)
    painted(path, tmp_path / f"out.{container}", container)
    assert sound_of(tmp_path / f"out.{container}")[0][1] == kept


# -- what the muxer refuses


@pytest.mark.parametrize("rate", [8000, 11025])
def test_sound_that_the_muxer_refuses_is_encoded(rate: int, tmp_path: Path) -> None:
    """MP3 below 16 kHz is not allowed in MP4."""
    path = film(tmp_path / "r.mkv", sound="libmp3lame", rate=rate, options={"bf": "0"})
    assert_heard(path, tmp_path / "out.mp4", MARKS_S)
    assert sound_of(tmp_path / "out.mp4")[0][0] == "aac"


def test_a_refusal_in_the_middle_does_not_lose_the_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = film(tmp_path / "a.mp4", options={"bf": "0"})
    copied = audio.TrackWriter._copied

    def twice(self: audio.TrackWriter, *rest: Any) -> Any:
        for time, packet in copied(self, *rest):
            yield time, packet
            if time > 0.5:
                packet.pts = packet.dts = 0
                yield time, packet

    monkeypatch.setattr(audio.TrackWriter, "_copied", twice)
    notes = painted(path, tmp_path / "out.mp4")
    assert click_times(tmp_path / "out.mp4") == pytest.approx(MARKS_S, abs=0.02)
    assert [note.code for note in notes] == ["sound"] and "encoded" in notes[0].message

    def never(self: audio.TrackWriter, *rest: Any) -> Any:
        raise ValueError("not today")
        yield

    monkeypatch.setattr(audio.TrackWriter, "_encoded", never)
    notes = painted(path, tmp_path / "silent.mp4")
    assert "left out" in notes[-1].message and len(flash_times(tmp_path / "silent.mp4")) == 4


def test_damaged_sound_becomes_silence_and_is_named(tmp_path: Path) -> None:
    path = film(tmp_path / "d.mkv", sound="flac", options={"bf": "0"})
    with av.open(str(path)) as source:
        places = [(p.pos, p.size) for p in source.demux(audio=0) if p.size]
    data = bytearray(path.read_bytes())
    for at, size in places[5:8]:
        data[at + 6 : at + size] = bytes(size - 6)
    path.write_bytes(data)
    notes = painted(path, tmp_path / "out.mp4")
    assert click_times(tmp_path / "out.mp4")[-1] == pytest.approx(MARKS_S[-1], abs=0.02)
    assert any("damaged" in note.message for note in notes)


# -- starts


@pytest.mark.parametrize("codec", ["aac", "libopus", "pcm_s16le"])
@pytest.mark.parametrize("late_s", [0.3, 0.7])
def test_late_sound_begins_late(late_s: float, codec: str, tmp_path: Path) -> None:
    path = film(tmp_path / "l.mkv", sound=codec, options={"bf": "0"}, keeps=lambda time_s: time_s >= late_s)
    assert_heard(path, tmp_path / "out.mp4", [mark for mark in MARKS_S if mark > late_s + 0.05])


@pytest.mark.parametrize("name", ["e.mkv", "e.mov", "e.ts"])
@pytest.mark.parametrize("container", ["mp4", "webm"])
def test_sound_before_the_first_picture_is_kept(name: str, container: str, tmp_path: Path) -> None:
    times = [500 + 40 * at for at in range(40)]
    path = film(tmp_path / name, "mpeg4", "libmp3lame", times, options={"bf": "0"})
    painted(path, out := tmp_path / f"out.{container}", container)
    assert click_times(out) == pytest.approx(MARKS_S, abs=0.03)
    assert flash_times(out) == pytest.approx([mark + 0.5 for mark in MARKS_S], abs=0.03)


def test_a_piece_begins_with_its_first_picture(tmp_path: Path) -> None:
    path = film(tmp_path / "p.mp4")
    painted(path, tmp_path / "out.mp4", piece=(10, 30))
    assert flash_times(tmp_path / "out.mp4") == pytest.approx([0.2, 0.6], abs=0.01)
    assert click_times(tmp_path / "out.mp4") == pytest.approx([0.2, 0.6], abs=0.02)


def test_sound_with_absurd_times_is_cut_and_named(tmp_path: Path) -> None:
    path = tmp_path / "far.mkv"
    whole = film(tmp_path / "a.mkv", sound="flac", options={"bf": "0"})
    with av.open(str(whole)) as source, av.open(str(path), "w") as out:
        streams = {s.index: out.add_stream_from_template(s) for s in source.streams}
        for packet in source.demux():
            if packet.size:
                if packet.stream.type == "audio" and packet.pts * packet.time_base > 1:
                    packet.pts += 3600 * 1000
                    packet.dts = packet.pts
                packet.stream = streams[packet.stream_index]
                out.mux(packet)
    notes = painted(path, tmp_path / "out.mp4")
    assert any("hole" in note.message for note in notes)
    with av.open(str(tmp_path / "out.mp4")) as made:
        assert made.duration < 3_000_000


# -- what else a film carries


def carrying(path: Path, subtitles: str = "") -> Path:
    whole = film(path.with_name("plain.mp4"))
    with av.open(str(whole)) as source, av.open(str(path), "w") as out:
        out.metadata.update({"title": "The Boat", "date": "2026-04-01", "comment": "Take 3", "artist": "A. Painter"})
        out.set_chapters([
            {"id": 1, "start": 0, "end": 800, "time_base": Fraction(1, 1000), "metadata": {"title": "Out"}},
            {"id": 2, "start": 800, "end": 1600, "time_base": Fraction(1, 1000), "metadata": {"title": "Back"}},
        ])  # fmt: skip
        streams = {s.index: out.add_stream_from_template(s) for s in source.streams}
        streams[0].metadata["timecode"] = "01:00:00:00"
        streams[1].metadata["language"] = "ita"
        if subtitles:
            text = out.add_mux_stream(subtitles)
            text.metadata["language"] = "fra"
        for packet in source.demux():
            if packet.size:
                packet.stream = streams[packet.stream_index]
                out.mux(packet)
        if subtitles:
            for at in (200, 1000):
                words = b"Bonjour"
                line = av.Packet((len(words).to_bytes(2, "big") if subtitles == "mov_text" else b"") + words)
                line.stream, line.time_base = text, Fraction(1, 1000)
                line.pts = line.dts = at
                line.duration = 300
                out.mux(line)
    return path


def test_title_dates_chapters_and_timecode_go_along(tmp_path: Path) -> None:
    notes = painted(carrying(tmp_path / "c.mov"), tmp_path / "out.mp4")
    assert notes == ()
    with av.open(str(tmp_path / "out.mp4")) as made:
        tags = made.metadata
        assert (tags["title"], tags["date"], tags["comment"]) == ("The Boat", "2026-04-01", "Take 3")
        chapters = [(c["metadata"]["title"], float(c["start"] * c["time_base"])) for c in made.chapters()]
        assert chapters == [("Out", 0.0), ("Back", pytest.approx(0.8, abs=0.01))]
        assert [s.metadata.get("timecode") for s in made.streams.video] == ["01:00:00:00"]
        assert made.streams.audio[0].language == "ita"
    notes = painted(tmp_path / "c.mov", tmp_path / "out.webm", "webm")
    assert [note.code for note in notes] == ["left-out"] and "01:00:00:00" in notes[0].message
    with av.open(str(tmp_path / "out.webm")) as made:
        assert made.metadata["title"] == "The Boat" and len(made.chapters()) == 2


def test_chapters_of_a_piece_are_cut(tmp_path: Path) -> None:
    notes = painted(carrying(tmp_path / "c.mov"), tmp_path / "out.mp4", piece=(10, 30))
    with av.open(str(tmp_path / "out.mp4")) as made:
        found = [(float(c["start"] * c["time_base"]), float(c["end"] * c["time_base"])) for c in made.chapters()]
    assert found == [(0.0, pytest.approx(0.4, abs=0.01)), (pytest.approx(0.4, abs=0.01), pytest.approx(0.8, abs=0.01))]
    assert notes == ()
    with av.open(str(tmp_path / "out.mp4")) as made:
        assert made.streams.video[0].metadata["timecode"] == "01:00:00:10"


def test_subtitles_go_along_or_are_named(tmp_path: Path) -> None:
    path = carrying(tmp_path / "s.mp4", "mov_text")
    assert painted(path, tmp_path / "out.mp4") == ()
    with av.open(str(tmp_path / "out.mp4")) as made:
        (text,) = made.streams.subtitles
        assert text.language == "fra"
        at = [float(p.pts * p.time_base) for p in made.demux(text) if p.size > 2]
    assert at == pytest.approx([0.2, 1.0], abs=0.002)


@pytest.mark.parametrize(("codec", "name"), [("subrip", "s.mkv"), ("webvtt", "s.mkv"), ("mov_text", "s.mp4")])
@pytest.mark.parametrize(("container", "held"), [("mp4", "mov_text"), ("webm", "webvtt")])
def test_texts_of_another_kind_are_converted(codec: str, name: str, container: str, held: str, tmp_path: Path) -> None:
    path, out = carrying(tmp_path / name, codec), tmp_path / f"out.{container}"
    notes = painted(path, out, container)
    assert [note.message for note in notes if "converted" in note.message] == (
        [] if codec == held else [f"Subtitles were converted to {held}: {codec}, fra."]
    )
    assert _lines(out) == [(0.2, 0.3, "Bonjour"), (1.0, 0.3, "Bonjour")]
    with av.open(str(out)) as made:
        assert [(s.language, s.codec_context.codec.canonical_name) for s in made.streams.subtitles] == [("fra", held)]
    painted(path, out, container, piece=(6, 30))
    assert _lines(out) == [(0.0, 0.26, "Bonjour"), (0.76, 0.3, "Bonjour")]


def _lines(path: Path) -> list[tuple[float, float, str]]:
    """Time, duration, s, and text of the subtitles."""
    with av.open(str(path)) as made:
        packets = [p for p in made.demux(made.streams.subtitles[0]) if p.size and bytes(p) != b"\0\0"]
        texts = [bytes(p).removeprefix(b"\0\x07").decode() for p in packets]
        times = [(float(p.pts * p.time_base), float(p.duration * p.time_base)) for p in packets]
    return [(round(at, 2), round(long, 2), text) for (at, long), text in zip(times, texts, strict=True)]


def test_styled_texts_keep_their_words_and_pictures_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(film(tmp_path / "plain.mp4"))) as source, av.open(str(path), "w") as out:
        streams = {s.index: out.add_stream_from_template(s) for s in source.streams}
        styled, drawn = out.add_stream("ass"), out.add_mux_stream("hdmv_pgs_subtitle")
        styled.codec_context.subtitle_header = _ASS
        for packet in source.demux():
            if packet.size:
                packet.stream = streams[packet.stream_index]
                out.mux(packet)
        line = SubtitleSet.create(rb"0,0,Default,,0,0,0,,{\i1}Ahoy{\i0}\Nthere", 0, 300, 200)
        for made, target in ((styled.codec_context.encode_subtitle(line), styled), (av.Packet(b"\x80\0\0"), drawn)):
            made.stream, made.time_base, made.duration = target, Fraction(1, 1000), 300
            made.pts = made.dts = 200
            out.mux(made)
    notes = painted(path, tmp_path / "out.webm", "webm")
    assert "hdmv_pgs_subtitle" in notes[-2].message and "converted" in notes[-1].message
    ((at, _duration, text),) = _lines(tmp_path / "out.webm")
    assert at == 0.2 and text.replace("<i>", "").replace("</i>", "") == "Ahoy\nthere"


_ASS = b"""[Script Info]
ScriptType: v4.00+

[V4+ Styles]
Format: Name, Fontname, Fontsize
Style: Default,Arial,16

[Events]
Format: Layer, Start, End, Style, Name, MarginL, MarginR, MarginV, Effect, Text
"""


def test_the_same_film_has_the_same_bytes(tmp_path: Path) -> None:
    path = carrying(tmp_path / "c.mov")
    for name in ("a.mp4", "b.mp4"):
        painted(path, tmp_path / name)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_file_without_sound_has_no_tracks(tmp_path: Path) -> None:
    assert tracks_of(film(tmp_path / "n.mp4", sound=None)) == []
    assert audio.audio_of(av.open(io.BytesIO((tmp_path / "n.mp4").read_bytes()))) is None
