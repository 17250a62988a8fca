"""Films as recorders, editors and old programs write them are read as their maker meant them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.video.damage import damage_of
from pipeline.video.media import SourceOptions
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from tests.pipeline.video.films import (
    FLASHES,
    FRAMES,
    HEIGHT,
    MARKS_S,
    NOT_CODED,
    WIDTH,
    click_times,
    coded,
    edited,
    film,
    flash_times,
    frame,
    joined,
    painted,
    write_avi,
)


def read(path: Path, options: SourceOptions | None = None) -> tuple[list[np.ndarray], list[float], bool]:
    """Frames, their times from the first, s, and whether anything is damaged."""
    with VideoReader(path, options=options) as reader:
        frames = list(reader.read())
        times = [float((t - reader.timestamps[0]) * reader.time_base) for t in reader.timestamps]
        return frames, times, bool(damage_of(reader.index, (*reader.unreadable, *reader.index.incomplete)))


def flashes(frames: list[np.ndarray]) -> list[int]:
    white = [bool(each.mean() > 200) for each in frames]
    return [at for at, now in enumerate(white) if now and not (at and white[at - 1])]


def assert_synchronous(source: Path, out: Path, flash_s: list[float], click_s: list[float] | None = None) -> None:
    """Each flash and click of the painted film at its time; without `click_s`, each click with its flash."""
    painted(source, out)
    seen, heard = flash_times(out), click_times(out)
    assert seen == pytest.approx(flash_s, abs=0.025)
    assert heard == pytest.approx(seen if click_s is None else click_s, abs=0.02)


# -- times


VARIABLE = [*range(0, 800, 40), *range(800, 2800, 200), *range(2800, 3200, 40)]
REPEATED = {
    "one": {8: 7},
    "three in a row": {8: 7, 9: 7},
    "in the slow part": {25: 24},
    "the last": {39: 38},
}


@pytest.mark.parametrize("which", REPEATED)
def test_repeated_times_do_not_change_the_others(which: str, tmp_path: Path) -> None:
    times = [VARIABLE[REPEATED[which].get(at, at)] for at in range(FRAMES)]
    path = film(tmp_path / "v.mkv", "mpeg4", None, times, options={"g": "12", "bf": "0"})
    frames, found, damaged = read(path)
    assert len(frames) == FRAMES and flashes(frames) == list(FLASHES) and not damaged
    kept = [at for at in range(FRAMES) if at not in REPEATED[which]]
    assert [found[at] for at in kept] == pytest.approx([VARIABLE[at] / 1000 for at in kept], abs=0.0015)
    assert all(b > a for a, b in pairwise(found))
    with VideoReader(path) as reader:
        assert [note.code for note in reader.notes] == ["corrected-times"]


def test_packets_of_pictures_that_are_never_shown_are_not_counted(tmp_path: Path) -> None:
    """Old encoders of VP9 wrote alternate references in packets of their own, with the time of the next picture."""
    options = {"auto-alt-ref": "1", "lag-in-frames": "12", "g": "40", "deadline": "good", "cpu-used": "4"}
    whole = film(tmp_path / "a.webm", "libvpx-vp9", None, options=options)
    with av.open(str(whole)) as source, av.open(str(tmp_path / "b.webm"), "w") as out:
        stream = out.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            for data in superframe(bytes(packet)) if packet.size else []:
                part = av.Packet(data)
                part.pts, part.dts, part.time_base, part.stream = packet.pts, packet.dts, packet.time_base, stream
                part.is_keyframe = packet.is_keyframe
                out.mux(part)
    frames, times, _damaged = read(tmp_path / "b.webm")
    assert (len(frames), flashes(frames)) == (FRAMES, list(FLASHES))
    assert times == pytest.approx([at / 25 for at in range(FRAMES)], abs=0.002)


def superframe(data: bytes) -> list[bytes]:
    """The frames of a VP9 packet (VP9 bitstream specification, annex B)."""
    marker = data[-1]
    if marker & 0xE0 != 0xC0:
        return [data]
    count, width = (marker & 7) + 1, (marker >> 3 & 3) + 1
    table = data[-1 - count * width : -1]
    sizes = [int.from_bytes(table[at * width : (at + 1) * width], "little") for at in range(count)]
    starts = [sum(sizes[:at]) for at in range(count)]
    return [data[start : start + size] for start, size in zip(starts, sizes, strict=True)]


PAUSES = {
    "one": [*range(0, 1000, 40), *range(1560, 2560, 40)],
    "several": [*range(0, 400, 40), *range(1000, 1400, 40), *range(2500, 2900, 40), *range(9000, 9400, 40)],
    "before the last frame": [*range(0, 1000, 40), 3000],
}


@pytest.mark.parametrize("name", ["p.mkv", "p.webm", "p.mp4", "p.flv", "p.mov"])
@pytest.mark.parametrize("which", PAUSES)
def test_a_still_screen_is_no_damage(which: str, name: str, tmp_path: Path) -> None:
    times = PAUSES[which]
    codec, options = {"p.webm": ("libvpx", {"g": "10", "lag-in-frames": "0"}), "p.flv": ("flv", {"g": "10"})}.get(
        name, ("mpeg4", {"g": "10", "bf": "0"})
    )
    path = film(tmp_path / name, codec, None, times, range(len(times)), options=options)
    frames, found, damaged = read(path)
    assert len(frames) == len(times) and not damaged
    assert found == pytest.approx([time / 1000 for time in times], abs=0.0015)
    assert probe(path).damage == ""


@pytest.mark.parametrize("flags", ["frag_keyframe+empty_moov", "frag_keyframe+default_base_moof", "dash"])
def test_a_fragmented_mp4_is_no_damage(flags: str, tmp_path: Path) -> None:
    whole = film(tmp_path / "a.mp4")
    with av.open(str(whole)) as source, av.open(str(tmp_path / "f.mp4"), "w", options={"movflags": flags}) as out:
        streams = {s.index: out.add_stream_from_template(s) for s in source.streams}
        for packet in source.demux():
            if packet.size:
                packet.stream = streams[packet.stream_index]
                out.mux(packet)
    frames, _times, damaged = read(tmp_path / "f.mp4")
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)


@pytest.mark.parametrize("offset_s", [0.0, 0.41, 0.8, 30.0, 40000.0])
def test_joined_transport_streams_run_on(offset_s: float, tmp_path: Path) -> None:
    first = film(tmp_path / "a.ts", frames=range(20), options={"g": "10", "bf": "0"})
    second = film(tmp_path / "b.ts", frames=range(20, 40), offset_s=offset_s, options={"g": "10", "bf": "0"})
    path = joined(tmp_path / "j.ts", first, second)
    frames, times, damaged = read(path)
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)
    assert times == pytest.approx([at / 25 for at in range(FRAMES)], abs=0.025)
    assert_synchronous(path, tmp_path / "out.mp4", MARKS_S)


def test_three_parts_with_b_frames_run_on(tmp_path: Path) -> None:
    spans = (range(13), range(13, 27), range(27, 40))
    parts = [film(tmp_path / f"{s.start}.ts", frames=s, offset_s=o) for s, o in zip(spans, (5, 0, 700), strict=True)]
    path = joined(tmp_path / "j.ts", *parts)
    frames, times, damaged = read(path)
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)
    assert times == pytest.approx([at / 25 for at in range(FRAMES)], abs=0.06)
    painted(path, tmp_path / "out.mp4")
    apart = np.subtract(click_times(tmp_path / "out.mp4"), flash_times(tmp_path / "out.mp4"))
    assert len(apart) == 4 and abs(apart).max() < 0.03


def test_joined_program_streams_run_on(tmp_path: Path) -> None:
    def part(name: str, frames: range) -> Path:
        return film(tmp_path / name, "mpeg1video", "mp2", frames=frames, options={"g": "10", "bf": "0"})

    path = joined(tmp_path / "j.mpg", part("a.mpg", range(20)), part("b.mpg", range(20, 40)))
    frames, times, damaged = read(path)
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)
    assert times == pytest.approx([at / 25 for at in range(FRAMES)], abs=0.06)


# -- edit lists

EDITS: dict[str, tuple[dict[str, list[tuple[float, float]]], list[float], list[float]]] = {
    "trimmed start": ({"vide": [(0.4, 1.2)], "soun": [(0.4, 1.2)]}, [0.2, 0.6, 1.0], [0.2, 0.6, 1.0]),
    "trimmed end": ({"vide": [(0, 0.8)], "soun": [(0, 0.8)]}, [0.2, 0.6], [0.2, 0.6]),
    "trimmed within a group": ({"vide": [(0.5, 0.7)], "soun": [(0.5, 0.7)]}, [0.1, 0.5], [0.1, 0.5]),
    "late picture": ({"vide": [(-1, 0.3), (0, 1.6)]}, [0.5, 0.9, 1.3, 1.7], MARKS_S),
    "late sound": ({"soun": [(-1, 0.3), (0, 1.3)]}, MARKS_S, [0.5, 0.9, 1.3]),
    "played twice": ({"vide": [(0, 0.8), (0, 0.8)], "soun": [(0, 0.8), (0, 0.8)]}, MARKS_S, MARKS_S),
    "two parts": ({"vide": [(0.8, 0.8), (0, 0.4)], "soun": [(0.8, 0.8), (0, 0.4)]}, [0.2, 0.6, 1.0], [0.2, 0.6, 1.0]),
}


@pytest.mark.parametrize("which", EDITS)
def test_edit_lists_are_played(which: str, tmp_path: Path) -> None:
    edits, flash_s, click_s = EDITS[which]
    path = edited(film(tmp_path / "a.mp4", options={"g": "12", "bf": "2"}), tmp_path / "e.mp4", **edits)
    assert not read(path)[2]
    assert_synchronous(path, tmp_path / "out.mp4", flash_s, click_s)


# -- AVI


def avi_packets(tmp_path: Path, b_frames: int) -> tuple[list[bytes], list[bool]]:
    return coded(film(tmp_path / "raw.avi", "mpeg4", None, options={"g": "12", "bf": str(b_frames), "b": "4000000"}))


def packed(chunks: list[bytes], keys: list[bool]) -> tuple[list[bytes], list[bool]]:
    """A picture and the B-frame after it in one chunk, then a chunk with a picture that is not coded, as DivX wrote."""
    found: list[tuple[bytes, bool]] = []
    at = 0
    while at < len(chunks):
        kind = chunks[at + 1][chunks[at + 1].index(b"\0\0\1\xb6") + 4] >> 6 if at + 1 < len(chunks) else 0
        if kind == 2:
            found += [(chunks[at] + chunks[at + 1], keys[at]), (NOT_CODED, False)]
            at += 2
        else:
            found.append((chunks[at], keys[at]))
            at += 1
    start = found[0][0].index(b"\0\0\1\xb6")
    found[0] = (found[0][0][:start] + b"\0\0\1\xb2DivX503b1393p" + found[0][0][start:], True)
    return [data for data, _key in found], [key for _data, key in found]


def not_coded(chunks: list[bytes], keys: list[bool]) -> tuple[list[bytes], list[bool]]:
    return [NOT_CODED if at in (7, 8, 9, 18, 19) else chunk for at, chunk in enumerate(chunks)], keys


def all_keys(chunks: list[bytes], keys: list[bool]) -> tuple[list[bytes], list[bool]]:
    return chunks, [True] * len(keys)


Change = Callable[[list[bytes], list[bool]], tuple[list[bytes], list[bool]]]
AVIS: dict[str, tuple[int, Change]] = {
    "B-frames": (1, lambda chunks, keys: (chunks, keys)),
    "packed B-frames": (1, packed),
    "not-coded pictures": (0, not_coded),
    "every frame marked as key": (0, all_keys),
}


@pytest.mark.parametrize("which", AVIS)
def test_avi_files_of_old_programs_are_read_whole(which: str, tmp_path: Path) -> None:
    b_frames, change = AVIS[which]
    path = write_avi(tmp_path / "a.avi", b"DX50", *change(*avi_packets(tmp_path, b_frames)))
    frames, times, damaged = read(path)
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)
    assert times == pytest.approx([at / 25 for at in range(FRAMES)], abs=0.001)
    assert probe(path).frames == FRAMES
    with VideoReader(path) as reader:
        for start in (30, 3, 17, 38, 8):
            assert all(np.array_equal(a, frames[start + at]) for at, a in enumerate(reader.read(start, start + 2)))


def test_h264_with_b_frames_in_avi(tmp_path: Path) -> None:
    path = film(tmp_path / "h.avi", "libx264", "libmp3lame", options={"g": "12", "bf": "3"})
    frames, _times, damaged = read(path)
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)
    painted(path, tmp_path / "out.mp4")
    apart = np.subtract(click_times(tmp_path / "out.mp4"), flash_times(tmp_path / "out.mp4"))
    assert len(apart) == 4 and np.ptp(apart) < 0.01


@pytest.mark.parametrize("dropped", [(7, 8, 9, 18, 19), (1, 23, 26), tuple(range(16, 30, 2))])
@pytest.mark.parametrize(("fourcc", "codec"), [(b"XVID", "mpeg4"), (b"H264", "libx264"), (b"MJPG", "mjpeg")])
def test_empty_chunks_of_an_avi_repeat_the_picture_before(
    fourcc: bytes, codec: str, dropped: tuple[int, ...], tmp_path: Path
) -> None:
    """Recorders write an empty chunk for a picture that they dropped."""
    kept = [at for at in range(FRAMES) if at not in dropped]
    chunks, keys = coded(film(tmp_path / "raw.avi", codec, None, frames=kept, options={"g": "12", "bf": "0"}))
    held = [b"" if at in dropped else chunks[kept.index(at)] for at in range(FRAMES)]
    marks = [at not in dropped and keys[kept.index(at)] for at in range(FRAMES)]
    path = write_avi(tmp_path / "d.avi", fourcc, held, marks)
    frames, times, damaged = read(path)
    assert (len(frames), flashes(frames), damaged) == (FRAMES, list(FLASHES), False)
    assert times == pytest.approx([at / 25 for at in range(FRAMES)], abs=0.001)
    assert all(np.array_equal(frames[at], frames[at - 1]) for at in dropped)
    with VideoReader(path) as reader:
        for start in (30, 3, 17, 38, 8):
            assert all(np.array_equal(a, frames[start + at]) for at, a in enumerate(reader.read(start, start + 2)))


def test_pictures_that_are_not_coded_between_b_frames(tmp_path: Path) -> None:
    chunks, keys = avi_packets(tmp_path, 1)
    kept = [NOT_CODED if at in (20, 21, 22) else chunk for at, chunk in enumerate(chunks)]
    frames, times, damaged = read(write_avi(tmp_path / "n.avi", b"DX50", kept, keys))
    assert (len(frames), damaged) == (FRAMES, False)
    assert [times[at] for at in flashes(frames)] == pytest.approx(MARKS_S)


@pytest.mark.parametrize("length", [400, 1 << 30, 0])
def test_a_length_in_an_avi_header_is_no_damage(length: int, tmp_path: Path) -> None:
    path = write_avi(tmp_path / "l.avi", b"XVID", *avi_packets(tmp_path, 0), length=length)
    frames, _times, damaged = read(path)
    assert (len(frames), damaged) == (FRAMES, False)


# -- fields


def fields_of(number: int) -> np.ndarray:
    """A white block on gray that moves by 3 px a field; number: of the field."""
    made = np.full((HEIGHT, WIDTH), 48, np.uint8)
    made[12:52, 8 + 3 * number : 24 + 3 * number] = 235
    return made


def interlaced(path: Path, codec: str, top_first: bool = True, options: dict[str, str] | None = None) -> Path:
    with av.open(str(path), "w") as out:
        video = out.add_stream(codec, rate=25, options=options or {})
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        if codec != "libx264":
            video.codec_context.flags |= 0x40000 | 0x20000000  # interlaced DCT and motion estimation
        for at in range(10):
            woven = fields_of(2 * at)
            woven[int(top_first) :: 2] = fields_of(2 * at + 1)[int(top_first) :: 2]
            picture = av.VideoFrame.from_ndarray(np.repeat(woven[..., None], 3, 2), format="rgb24")
            picture.pts, picture.time_base = at, Fraction(1, 25)
            out.mux(video.encode(picture))
        out.mux(video.encode(None))
    return path


def combing(picture: np.ndarray) -> float:
    """Share of pixels that differ from both neighbours in their column in the same direction."""
    gray = picture[..., 1].astype(int)[14:50]
    above, below = gray[1:-1] - gray[:-2], gray[1:-1] - gray[2:]
    return float(((above * below > 0) & (abs(above) > 40) & (abs(below) > 40)).mean())


INTERLACED = {
    "h264": ("i.mp4", "libx264", {"crf": "8", "x264-params": "interlaced=1:tff=1", "g": "4"}),
    "mpeg2 in ts": ("i.ts", "mpeg2video", {"qscale": "2", "b": "8000000", "g": "4"}),
    "mpeg2 in mkv": ("i.mkv", "mpeg2video", {"qscale": "2", "b": "8000000", "g": "4"}),
}


@pytest.mark.parametrize("which", INTERLACED)
def test_interlaced_films_have_no_combs(which: str, tmp_path: Path) -> None:
    name, codec, options = INTERLACED[which]
    path = interlaced(tmp_path / name, codec, options=options)
    frames, _times, _damaged = read(path)
    woven, _, _ = read(path, SourceOptions(fields="progressive"))
    assert len(frames) == len(woven) == 10
    assert min(combing(f) for f in woven[1:-1]) > 0.03 and max(combing(f) for f in frames[1:-1]) < 0.005
    with VideoReader(path) as reader:
        assert "deinterlaced" in [note.code for note in reader.notes]
        for start in (7, 4, 5, 1, 8, 0):
            assert all(np.array_equal(a, frames[start + at]) for at, a in enumerate(reader.read(start, start + 2)))


def test_fields_of_an_unmarked_film_are_read_as_told(tmp_path: Path) -> None:
    path = interlaced(tmp_path / "u.mp4", "libx264", top_first=False, options={"crf": "8", "g": "4"})
    plain, _, _ = read(path)
    assert combing(plain[5]) > 0.03
    told, _, _ = read(path, SourceOptions(fields="bottom"))
    assert max(combing(f) for f in told[1:-1]) < 0.005
    with VideoReader(path, options=SourceOptions(fields="bottom")) as reader:
        assert np.array_equal(next(reader.read(4, 5)), told[4])


def test_a_progressive_film_is_not_filtered(tmp_path: Path) -> None:
    path = film(tmp_path / "p.mp4")
    plain = read(path, SourceOptions(fields="progressive"))[0]
    assert all(np.array_equal(a, b) for a, b in zip(read(path)[0], plain, strict=True))


# -- crops


def cropped_mov(path: Path) -> Path:
    """Clean aperture of 80 x 40 px, 4 px right of and 2 px above the middle."""
    data = film(path, sound=None).read_bytes()
    clap = struct.pack(">I4s8i", 40, b"clap", 80, 1, 40, 1, 4, 1, -2, 1)
    boxes = [data.rindex(name) - 4 for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"avc1")]
    entry = boxes[-1]
    end = entry + struct.unpack(">I", data[entry : entry + 4])[0]
    made = bytearray(data[:end] + clap + data[end:])
    for at in boxes:
        made[at : at + 4] = struct.pack(">I", struct.unpack(">I", made[at : at + 4])[0] + len(clap))
    path.write_bytes(made)
    return path


def cropped_mkv(path: Path) -> Path:
    """The same, as PixelCrop: FFmpeg's muxer writes what its demuxer has read."""
    with av.open(str(cropped_mov(path.with_suffix(".mov")))) as source, av.open(str(path), "w") as out:
        stream = out.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.size:
                packet.stream = stream
                out.mux(packet)
    assert b"\x54\xcc" in path.read_bytes()
    return path


@pytest.mark.parametrize("make", [cropped_mov, cropped_mkv])
def test_the_container_crops(make: Callable[[Path], Path], tmp_path: Path) -> None:
    whole = read(film(tmp_path / "whole.mov", sound=None))[0]
    frames = read(make(tmp_path / ("c.mov" if make is cropped_mov else "c.mkv")))[0]
    assert len(frames) == FRAMES
    assert np.array_equal(frames[7], whole[7][10:50, 12:92])


# -- streams


def two_streams(path: Path, sizes: tuple[tuple[int, int], ...]) -> Path:
    with av.open(str(path), "w") as out:
        streams = []
        for width, height in sizes:
            stream = out.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            streams.append(stream)
        for at in range(12):
            for number, (stream, (width, height)) in enumerate(zip(streams, sizes, strict=True)):
                picture = av.VideoFrame.from_ndarray(np.full((height, width, 3), 60 + 90 * number, np.uint8))
                picture.pts, picture.time_base = at, Fraction(1, 25)
                out.mux(stream.encode(picture))
        for stream in streams:
            out.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("name", ["t.mp4", "t.mkv", "t.ts"])
def test_one_of_several_video_streams_is_chosen(name: str, tmp_path: Path) -> None:
    path = two_streams(tmp_path / name, ((96, 64), (128, 96)))
    with VideoReader(path) as reader:
        assert [note.code for note in reader.notes] == ["stream-choice"]
    for number, size in enumerate(((96, 64), (128, 96))):
        with VideoReader(path, options=SourceOptions(number)) as reader:
            assert reader.size == size
            assert abs(float(next(reader.read(5, 6)).mean()) - (60 + 90 * number)) < 5
    with pytest.raises(BadParameter, match="2 video streams"):
        VideoReader(path, options=SourceOptions(2))
    streams = probe(path).streams
    assert [(each["width"], each["height"], each["frames"]) for each in streams] == [(96, 64, 12), (128, 96, 12)]


def test_one_video_stream_needs_no_note(tmp_path: Path) -> None:
    with VideoReader(film(tmp_path / "a.mp4")) as reader:
        assert reader.notes == ()
    assert probe(tmp_path / "a.mp4").notes == () and probe(tmp_path / "a.mp4").streams == ()


# -- the beginning


def test_pictures_before_the_first_key_are_left_out(tmp_path: Path) -> None:
    """A recording of a broadcast that begins within a group."""
    whole = film(tmp_path / "a.ts", "mpeg2video", None, options={"g": "10", "bf": "2"})
    with av.open(str(whole)) as source, av.open(str(tmp_path / "b.ts"), "w") as out:
        stream = out.add_stream_from_template(source.streams.video[0])
        for at, packet in enumerate(source.demux(video=0)):
            if packet.size and at >= 9:
                packet.stream = stream
                out.mux(packet)
    with VideoReader(tmp_path / "b.ts") as reader:
        frames = list(reader.read())
        assert len(frames) == reader.frames and not damage_of(reader.index, reader.unreadable)
    with av.open(str(tmp_path / "b.ts")) as source:
        shown = [picture.to_ndarray(format="gray").mean() for picture in source.decode(video=0)]
    assert len(frames) == len(shown)


def test_ten_bit_white_is_white(tmp_path: Path) -> None:
    path = tmp_path / "w.mkv"
    with av.open(str(path), "w") as out:
        video = out.add_stream("ffv1", rate=25)
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p10le"
        picture = av.VideoFrame(WIDTH, HEIGHT, "yuv420p10le")
        for plane, value in zip(picture.planes, (940, 512, 512), strict=True):
            plane.update(np.full(plane.buffer_size // 2, value, "<u2").tobytes())
        picture.pts, picture.time_base = 0, Fraction(1, 25)
        out.mux(video.encode(picture))
        out.mux(video.encode(None))
    assert read(path)[0][0].min() == 255


def test_the_pictures_of_the_helper_are_as_expected() -> None:
    assert frame(5).min() == 255 and frame(6).mean() < 60
