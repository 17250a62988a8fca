"""`impasto batch`: an EDL of ten shots, the same cut as OTIO, manifests, versions, a watched folder, a service."""

from __future__ import annotations

import base64
import csv
import json
import threading
import time
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from impasto.batch.looks import load_config
from impasto.batch.run import Batch, Plan, shots_of
from impasto.cli.app import run
from impasto_client import Client
from pipeline.errors import BadInput, BadParameter
from pipeline.video.probe import probe
from service.settings import Settings
from tests.service.live import running
from workers.contract.request import Json
from workers.farm import open_farm

FPS, FRAMES = 24, 60
LOOKS = """
names = "{cut}_{shot}_v{version}.mov"
handles = 1
[look]
params = {lines = "off"}
"""
EVENTS = 10


def film(path: Path, timecode: str = "") -> Path:
    """A film of 60 frames at 24 frames per second, with the timecode of its first frame."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=FPS, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        if timecode:
            stream.metadata["timecode"] = timecode
        for index in range(FRAMES):
            picture = np.full((48, 64, 3), 3 * index, np.uint8)
            picture[10:30, index % 40 : index % 40 + 20] = (200, 60, 40)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        out.mux(stream.encode(None))
    return path


def label(frame: int, hour: int = 0) -> str:
    return f"{hour:02d}:00:{frame // FPS:02d}:{frame % FPS:02d}"


def length(event: int) -> int:
    return 2 + event


@pytest.fixture(scope="module")
def edl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cut of ten shots: odd ones from a film with timecode from 01:00:00:00, even ones from a film without."""
    folder = tmp_path_factory.mktemp("edit")
    (folder / "plates").mkdir()
    film(folder / "plates" / "A001.mov", "01:00:00:00")
    film(folder / "plates" / "b.mp4")
    rows, record = ["TITLE: REEL1", "FCM: NON-DROP FRAME", ""], 0
    for event in range(1, EVENTS + 1):
        hour, name = (1, "A001.mov") if event % 2 else (0, "b.mp4")
        start, frames = 3 * event, length(event)
        times = [label(start, hour), label(start + frames, hour), label(record, 10), label(record + frames, 10)]
        rows += [f"{event:03d}  AX       V     C        {' '.join(times)}", f"* FROM CLIP NAME: {name}"]
        record += frames
    path = folder / "reel1.edl"
    path.write_text("\n".join(rows) + "\n")
    (folder / "looks.toml").write_text(LOOKS)
    return path


def batch(*words: object) -> int:
    return run(["batch", *map(str, words), "--quiet"])


def facts(path: Path) -> tuple[int, str]:
    with av.open(str(path)) as made:
        return probe(path).frames, made.streams.video[0].metadata.get("timecode", "")


def test_an_edl_of_ten_shots_is_painted_once(edl: Path, home: Path, tmp_path: Path) -> None:
    words = (edl, "--config", edl.parent / "looks.toml", "--fps", FPS, "-o", tmp_path / "out", "--home", home)
    assert batch(*words) == 0
    found = {path.name: facts(path) for path in sorted((tmp_path / "out").glob("*.mov"))}
    expected = {}
    for event in range(1, EVENTS + 1):
        clip = "A001" if event % 2 else "b"
        start = label(3 * event - 1, 1) if event % 2 else ""
        expected[f"reel1_{clip}_{event:03d}_v001.mov"] = (length(event) + 2, start)
    assert found == expected
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*.mov")}
    again = tmp_path / "out" / ".." / "out"
    assert batch(*(again if word == tmp_path / "out" else word for word in words)) == 0
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*.mov")} == before, "nothing is painted"


class Painter:
    """Records what is to be painted, and writes a small file instead of a film."""

    def __init__(self) -> None:
        self.plans: list[Plan] = []

    def __call__(self, plan: Plan) -> Json:
        self.plans.append(plan)
        plan.where.path.parent.mkdir(parents=True, exist_ok=True)
        plan.where.path.write_bytes(b"film")
        first, end = plan.request.frames or (0, FRAMES)
        return {"frames": end - first, "warnings": []}


def paint(source: Path, output: Path, looks: str = LOOKS, fps: float | None = FPS) -> tuple[list[Json], list[Plan]]:
    """Rows and plans of one run."""
    config_file, painter = output.parent / "looks.toml", Painter()
    output.parent.mkdir(parents=True, exist_ok=True)
    config_file.write_text(looks)
    config = load_config(config_file, output.parent)[0].model_copy(update={"fps": fps})
    rows = list(Batch(config, output, source.parent).run(shots_of(source, config), painter))
    return rows, painter.plans


def test_a_change_makes_a_new_version_of_what_it_changes(edl: Path, tmp_path: Path) -> None:
    out = tmp_path / "a" / "out"
    rows, plans = paint(edl, out)
    assert [row["state"] for row in rows] == ["painted"] * EVENTS
    assert paint(edl, out)[1] == []
    other = LOOKS + '[looks.bold]\nparams = {lines = "on"}\n[[shots]]\nmatch = "*_003"\nlook = "bold"\n'
    rows, again = paint(edl, out, other)
    assert [plan.where.path.name for plan in again] == ["reel1_A001_003_v002.mov"]
    assert again[0].request.params == {"lines": "on"} and again[0].request.frames == plans[2].request.frames
    assert (out / "reel1_A001_003_v001.mov").exists() and len(list(out.glob("*.mov"))) == EVENTS + 1
    assert paint(edl, out)[1] == [], "the first version is known by its content"
    (out / "reel1_A001_003_v002.mov").unlink()
    assert [plan.version for plan in paint(edl, out, other)[1]] == [2], "a deleted result is painted again"


def test_a_foreign_file_is_not_overwritten(edl: Path, tmp_path: Path) -> None:
    out = tmp_path / "a" / "out"
    out.mkdir(parents=True)
    (out / "reel1_b_002_v001.mov").write_bytes(b"mine")
    _rows, plans = paint(edl, out)
    assert plans[1].where.path.name == "reel1_b_002_v002.mov"
    assert (out / "reel1_b_002_v001.mov").read_bytes() == b"mine"


def test_otio_with_a_dissolve_a_retime_and_short_handles(edl: Path, tmp_path: Path) -> None:
    import opentimelineio as otio

    def time_of(frames: int) -> otio.opentime.RationalTime:
        return otio.opentime.RationalTime(frames, FPS)

    def clip(name: str, start: int, frames: int) -> otio.schema.Clip:
        begin = otio.opentime.TimeRange(time_of(FPS * 3600), time_of(FRAMES))
        media = otio.schema.ExternalReference(str(edl.parent / "plates" / "A001.mov"), begin)
        return otio.schema.Clip(name, media, otio.opentime.TimeRange(time_of(FPS * 3600 + start), time_of(frames)))

    line = otio.schema.Timeline("cut")
    fast = clip("sh020", 20, 5)
    fast.effects.append(otio.schema.LinearTimeWarp("fast", time_scalar=2.0))
    dissolve = otio.schema.Transition(in_offset=time_of(2), out_offset=time_of(3))
    line.tracks.append(otio.schema.Track(children=[clip("sh010", 0, 10), dissolve, fast]))
    path = tmp_path / "cut.otio"
    otio.adapters.write_to_file(line, str(path))
    rows, plans = paint(path, tmp_path / "a" / "out", fps=None)
    assert [(plan.shot.name, plan.request.frames) for plan in plans] == [("sh010", (0, 14)), ("sh020", (17, 31))]
    assert rows[0]["warnings"] == ["The source has 0 and 1 of 1 frames of handles."]
    assert "speed of 2" in rows[1]["warnings"][0]


@pytest.mark.parametrize("kind", ["csv", "json"])
def test_a_manifest_of_fifty_files(kind: str, edl: Path, tmp_path: Path) -> None:
    rows = [{"source": str(edl.parent / "plates" / "A001.mov"), "shot": f"sh{n:03d}", "frames": f"{n}:{n + 5}",
             "seed": str(n), "params.lines": "off"} for n in range(49)]  # fmt: skip
    rows.append({"source": "A001.mov", "frames": "01:00:01:00-01:00:02:00", "handles": "0", "params.lines": "on"})
    path = tmp_path / f"shots.{kind}"
    if kind == "json":
        path.write_text(json.dumps(rows))
    else:
        with path.open("w", newline="") as file:
            table = csv.DictWriter(file, ["source", "shot", "frames", "seed", "params.lines", "handles"])
            table.writeheader()
            table.writerows(rows)
    looks = LOOKS + "[looks]\n"
    looks = f'media = ["{edl.parent / "plates"}"]\n' + looks
    made, plans = paint(path, tmp_path / "a" / "out", looks, None)
    assert [row["state"] for row in made] == ["painted"] * 50
    assert [plan.request.seed for plan in plans[:49]] == list(range(49))
    assert plans[5].request.frames == (4, 11) and plans[49].request.frames == (24, 48)
    assert plans[49].request.params == {"lines": "on"} and plans[49].shot.name == "A001"
    assert paint(path, tmp_path / "a" / "out", looks, None)[1] == []


def test_numbered_images_are_sources(tmp_path: Path) -> None:
    (tmp_path / "plates").mkdir()
    for number in range(1001, 1007):
        picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), number % 200, np.uint8), format="rgb24")
        picture.to_image().save(tmp_path / "plates" / f"sh010.{number}.png")
    rows = "source,shot,frames,handles\nplates/sh010.####.png,a,#1002-#1003,1\nplates,b,1:3,0\n"
    (tmp_path / "shots.csv").write_text(rows)
    made, plans = paint(tmp_path / "shots.csv", tmp_path / "a" / "out", fps=None)
    assert [row["state"] for row in made] == ["painted"] * 2, made
    assert [plan.request.frames for plan in plans] == [(0, 4), (1, 3)]


def test_a_shot_that_fails_does_not_stop_the_others(edl: Path, tmp_path: Path) -> None:
    path = tmp_path / "shots.json"
    plates = edl.parent / "plates"
    path.write_text(
        json.dumps([{"source": str(plates / "b.mp4"), "frames": "50:90"}, {"source": str(plates / "A001.mov")}])
    )
    rows, _plans = paint(path, tmp_path / "a" / "out", fps=None)
    assert [row["state"] for row in rows] == ["failed", "painted"]
    assert "0 to 60" in str(rows[0]["error"])


@pytest.mark.parametrize(
    ("looks", "why"),
    [
        ('names = "{shot}.mov"', "no version"),
        ('names = "{shto}_v{version}.mov"', "shot"),
        ('names = "{cut}_v{version}.mov"', "Two shots have one name"),
        ("handels = 3", "handels"),
        ('[look]\nmethod = 3\n', "look.method"),
        ('[[shots]]\nmatch = "*"\nlook = "nigth"\n[looks.night]\nseed = 2\n', "night"),
    ],
)  # fmt: skip
def test_a_wrong_configuration_names_the_field(looks: str, why: str, edl: Path, tmp_path: Path) -> None:
    with pytest.raises(BadParameter, match=why):
        paint(edl, tmp_path / "a" / "out", looks)


def test_what_cannot_be_a_cut_is_refused(edl: Path, tmp_path: Path) -> None:
    with pytest.raises(BadParameter, match="frame rate"):
        paint(edl, tmp_path / "a" / "out", fps=None)
    (tmp_path / "bad.otio").write_text("{")
    with pytest.raises(BadInput, match="cannot be read"):
        paint(tmp_path / "bad.otio", tmp_path / "a" / "out")
    (tmp_path / "other.txt").write_text("")
    with pytest.raises(BadInput, match="neither a cut nor a manifest"):
        paint(tmp_path / "other.txt", tmp_path / "a" / "out")
    lost = tmp_path / "lost" / "reel1.edl"
    lost.parent.mkdir()
    lost.write_text(edl.read_text())
    with pytest.raises(BadInput, match=r"A001\.mov"):
        paint(lost, tmp_path / "a" / "out")


def test_a_watched_folder_paints_what_arrives(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arriving, out, looks = tmp_path / "in", tmp_path / "out", 0
    arriving.mkdir()
    film(arriving / "one.mp4")
    painter = Painter()
    monkeypatch.setattr("impasto.cli.batch._here", lambda plan, options: painter(plan))
    monkeypatch.setattr("impasto.cli.batch.POLL_S", 0.0)

    sleep, here = time.sleep, threading.current_thread()

    def wait(seconds: float) -> None:
        nonlocal looks
        if threading.current_thread() is not here:
            sleep(seconds)
            return
        looks += 1
        if looks == 2:
            film(arriving / "two.mp4")
        if looks == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(time, "sleep", wait)
    assert batch(arriving, "--watch", "-o", out, "--home", home) == 130
    assert [plan.where.path.name for plan in painter.plans] == ["one_v001.mp4", "two_v001.mp4"]


def test_a_manifest_is_painted_at_a_service(edl: Path, home: Path, tmp_path: Path) -> None:
    path = tmp_path / "shots.csv"
    path.write_text(f"source,shot,frames,params.lines\n{edl.parent / 'plates' / 'A001.mov'},sh010,10:20,off\n")
    settings = Settings(home=tmp_path / "service", farm="local", workers=1)
    farm = open_farm(settings)
    farm.start()
    with running(settings, farm) as url:
        words = (path, "--server", url, "--names", "{shot}_v{version}.mov", "-o", tmp_path / "out", "--home", home)
        assert batch(*words) == 0 and batch(*words) == 0
        with Client(url) as client:
            (job,) = client.jobs(label="shot:sh010")
    farm.stop()
    assert facts(tmp_path / "out" / "sh010_v001.mov") == (10, "01:00:00:10")
    assert job["request"]["labels"] == {"batch": "shots", "shot": "sh010"}


PAINTING = b"not read here"


def look_file(path: Path, **changes: object) -> Path:
    """A look as the studio exports it."""
    look = {"title": "Night", "method": "abstraction", "params": {"lines": "off"}, "seed": 3, "inputs": {},
            "picture": "ast_1", **changes}  # fmt: skip
    files = {"ast_1": {"name": "look.png", "data": "data:image/png;base64," + base64.b64encode(PAINTING).decode()}}
    path.write_text(json.dumps({"impasto": "look", "version": 1, "look": look, "files": files}))
    return path


def test_a_look_of_the_studio_is_used_by_all_shots_or_where_the_configuration_names_it(tmp_path: Path) -> None:
    night = look_file(tmp_path / "night.look.json", inputs={"reference": "ast_1"}, regions={"sky": {"style": "dots"}})
    config, notes = load_config(None, tmp_path, night)
    _, look = config.look_of("sh010")
    assert (look.method, look.params, look.seed) == ("abstraction", {"lines": "off"}, 3)
    assert look.inputs["reference"].read_bytes() == PAINTING
    assert len(notes) == 1 and "styles of regions (sky)" in notes[0]

    toml = tmp_path / "looks.toml"
    toml.write_text(
        '[look]\nseed = 1\n[looks.night]\nfile = "night.look.json"\nparams = {line_width_px = 2.0}\n'
        '[[shots]]\nmatch = "sh02*"\nlook = "night"\n'
    )
    config, _ = load_config(toml, tmp_path)
    assert config.look_of("sh010")[1].seed == 1
    name, look = config.look_of("sh020")
    assert (name, look.seed, look.params) == ("night", 3, {"lines": "off", "line_width_px": 2.0})


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[1, 2]", "look"),
        ('{"impasto": "look", "version": 2, "look": {}, "files": {}}', "version"),
        ("no json", "Expecting value"),
    ],
)
def test_a_file_that_is_no_look_is_refused(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "wrong.look.json"
    path.write_text(text)
    with pytest.raises(BadInput, match="no look of Impasto") as refused:
        load_config(None, tmp_path, path)
    assert why in str(refused.value)
    look_file(path, inputs={"reference": "ast_2"})
    with pytest.raises(BadInput, match="lacks the painting of the input 'reference'"):
        load_config(None, tmp_path, path)


def test_a_folder_is_painted_with_a_look_of_the_studio(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    film(tmp_path / "in" / "a.mp4")
    look = look_file(tmp_path / "plain.look.json")
    out = tmp_path / "out"
    assert batch(tmp_path / "in", "--look", look, "-o", out, "--home", tmp_path / "home") == 0
    assert probe(out / "a_v001.mp4").frames == FRAMES


@pytest.mark.parametrize(
    ("rows", "field", "why"),
    [
        ("source,shot\na.mp4,s1,more", "row 1", "more cells than the heading"),
        ("source,shot,handles\na.mp4,s1,x", "row 1", "Handles are a number of frames"),
        ("source,shot\na.mp4,../../s1", "names", "leads out of the output folder"),
    ],
)
def test_a_wrong_manifest_names_the_row(tmp_path: Path, rows: str, field: str, why: str) -> None:
    film(tmp_path / "a.mp4")
    (tmp_path / "cut.csv").write_text(rows)
    config, _ = load_config(None, tmp_path)
    with pytest.raises(BadParameter) as error:
        list(Batch(config, tmp_path / "out", tmp_path).run(shots_of(tmp_path / "cut.csv", config), _not_painted))
    assert (error.value.field, why in error.value.message) == (field, True)


def _not_painted(plan: Plan) -> Json:
    raise AssertionError("nothing is painted")


@pytest.mark.parametrize("names", ["{shot}_v{version!x}.mp4", "{shot}_v{version:>9q}.mp4"])
def test_tokens_have_no_format(edl: Path, tmp_path: Path, names: str) -> None:
    assert run(["batch", str(edl), "--fps", "24", "-o", str(tmp_path / "out"), "--names", names]) == 2


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["empty"], "The folder has no films"),
        (["frames"], "The folder has no films"),
        (["films", "--fps", "25"], "--fps is for EDLs and manifests"),
        (["films", "--media", "films"], "--media is for cuts and manifests"),
        (["films", "--at-service", "--workers", "2"], "--workers is for this machine"),
        (["films", "--api-key", "k"], "--api-key is for a service"),
    ],
)
def test_what_a_batch_does_not_use_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("empty", "frames", "films"):
        (tmp_path / folder).mkdir()
    film(tmp_path / "films" / "a.mp4")
    _images(tmp_path / "frames", 2)
    assert run(["batch", *words, "-o", "out", "--home", "home"]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def _images(folder: Path, count: int) -> None:
    for number in range(1001, 1001 + count):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((48, 64, 3), number % 250, np.uint8))


def test_images_of_a_manifest_have_the_given_rate_and_whole_sources_no_handles(
    tmp_path: Path, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "films" / "shot").mkdir(parents=True)
    _images(tmp_path / "films" / "shot", 5)
    (tmp_path / "cut.csv").write_text("source,shot,frames\nfilms/shot/####.png,s1,#1002-#1004\nfilms/shot,s2,\n")
    words = ["batch", str(tmp_path / "cut.csv"), "-o", str(tmp_path / "out"), "--home", str(home), "--quiet", "--fps"]
    assert run([*words, "25", "--handles", "1"]) == 0
    assert "warning: s2: All frames of the source are painted: there are none for handles." in capsys.readouterr().err
    for name in ("s1", "s2"):
        info = probe(tmp_path / "out" / f"{name}_v001.mp4")
        assert (info.frames, info.fps) == (5, 25)
    assert run([*words, "25", "--handles", "2"]) == 0
    assert not (tmp_path / "out" / "s2_v002.mp4").exists(), "handles do not change it"


def test_folders_of_images_beside_films_are_named(
    tmp_path: Path, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "films" / "shot").mkdir(parents=True)
    _images(tmp_path / "films" / "shot", 2)
    film(tmp_path / "films" / "a.mp4")
    assert run(["batch", str(tmp_path / "films"), "-o", str(tmp_path / "out"), "--home", str(home), "--quiet"]) == 0
    assert "Left out, because it is no film: shot/." in capsys.readouterr().err
