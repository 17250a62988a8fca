"""The contract of `impasto render` as scripts use it: a real process, a real farm, a real file."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from impasto.cli.app import run
from tests.conftest import TINY_FRAMES, TINY_HEIGHT, TINY_WIDTH, tiny_frame
from tests.processes import started
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

LONG_FRAMES = 300
LONG_SIZE = (192, 128)


def impasto(*words: str | Path, home: Path) -> list[str]:
    return [sys.executable, "-m", "impasto", "render", *map(str, words), "--home", str(home)]


def script(*words: str | Path, home: Path) -> subprocess.CompletedProcess[str]:
    """Run `impasto render` as a process of its own."""
    command = impasto(*words, home=home)
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, stdin=subprocess.DEVNULL, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def summary(text: str) -> dict[str, Any]:
    last: dict[str, Any] = json.loads(text.splitlines()[-1])
    return last


@dataclass
class Here:
    """Runs `impasto render` in this process: the same words, without a second's start-up."""

    capsys: pytest.CaptureFixture[str]
    home: Path
    err: str = ""

    def __call__(self, *words: str | Path, code: int = 0) -> dict[str, Any]:
        status = run(["render", *map(str, words), "--home", str(self.home), "--json"])
        output = self.capsys.readouterr()
        self.err = output.err
        assert status == code, output
        return summary(output.out)


@pytest.fixture
def render(capsys: pytest.CaptureFixture[str], home: Path) -> Here:
    return Here(capsys, home)


def frames_of(path: Path) -> list[np.ndarray[Any, Any]]:
    with av.open(str(path)) as clip:
        return [frame.to_ndarray(format="rgb24") for frame in clip.decode(video=0)]


@pytest.fixture(scope="module")
def cartoon(tiny_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The tiny clip rendered to a video by a separate process, and the output of that process."""
    folder = tmp_path_factory.mktemp("cartoon")
    done = script(tiny_clip, "-o", folder / "out.mp4", "--seed", "7", "--json", home=folder / "home")
    return folder, summary(done.stdout)


def test_json_reports_outputs_and_times(cartoon: tuple[Path, dict[str, Any]]) -> None:
    folder, output = cartoon
    assert (output["frames"], output["width"], output["height"]) == (TINY_FRAMES, TINY_WIDTH, TINY_HEIGHT)
    assert output["output"] == str(folder / "out.mp4")
    assert output["seconds"] == pytest.approx(sum(output["steps"].values()), abs=0.01)
    assert output["fps"] == pytest.approx(output["frames"] / output["seconds"], rel=0.01)
    assert 0 < output["seconds"] < output["wall_seconds"]
    assert output["wall_fps"] == pytest.approx(output["frames"] / output["wall_seconds"], rel=0.01)
    assert {"decode", "encode"} <= set(output["stages"])
    assert "assemble" not in output["steps"]


def test_the_rendered_video_has_every_frame_and_the_sound(cartoon: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = cartoon
    frames = frames_of(folder / "out.mp4")
    assert len(frames) == TINY_FRAMES
    assert frames[0].shape == (TINY_HEIGHT, TINY_WIDTH, 3)
    with av.open(str(folder / "out.mp4")) as clip:
        assert len(clip.streams.audio) == 1


def test_no_temporary_files_are_left(cartoon: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = cartoon
    assert [p.name for p in folder.iterdir() if p.name != "home"] == ["out.mp4"]
    assert list((folder / "home" / "renders").iterdir()) == []


def test_a_folder_gets_lossless_frames_independent_of_the_number_of_workers(
    render: Here, tiny_clip: Path, tmp_path: Path
) -> None:
    assert render(tiny_clip, "-o", f"{tmp_path}/one/", "--workers", "1")["frames"] == TINY_FRAMES
    render(tiny_clip, "-o", f"{tmp_path}/two/", "--workers", "2")
    names = [f"{index:04d}.png" for index in range(TINY_FRAMES)]
    assert sorted(p.name for p in (tmp_path / "one").iterdir()) == names
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    first = cv2.imread(str(tmp_path / "one" / "0000.png"), cv2.IMREAD_UNCHANGED)
    assert first.shape == (TINY_HEIGHT, TINY_WIDTH, 3)


def test_a_render_uses_the_whole_machine_unless_a_number_of_workers_is_given(
    render: Here, tiny_clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[int] = []

    def watched(settings: FarmSettings, **options: Any) -> Farm:
        used.append(settings.workers)
        return open_farm(settings, **options)

    monkeypatch.setattr("workers.farm.open_farm", watched)
    render(tiny_clip, "-o", f"{tmp_path}/whole/")
    render(tiny_clip, "-o", f"{tmp_path}/three/", "--workers", "3")
    assert used == [0, 3]


def test_an_estimate_uses_the_methods_figures_then_earlier_renders(
    render: Here, tiny_clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.mp4"
    first = render(tiny_clip, "--estimate")
    assert (first["frames"], first["samples"]) == (TINY_FRAMES, 0)
    assert first["cpu_s"] > 0 and first["memory_bytes"] > 1e6 and first["disk_bytes"] > 0
    assert not out.exists(), "nothing is rendered"
    done = render(tiny_clip, "-o", out)
    second = render(tiny_clip, "-o", out, "--estimate")
    assert second["samples"] == 1
    assert 0 < second["seconds"] <= done["wall_seconds"]
    half = render(tiny_clip, "-o", out, "--estimate", "--frames", f"0:{TINY_FRAMES // 2}")
    assert half["seconds"] == pytest.approx(second["seconds"] / 2, abs=0.11)
    (render.home / "render-history.json").write_text("no list")
    assert render(tiny_clip, "-o", out, "--estimate")["samples"] == 0


@pytest.mark.parametrize("name", ["", "####.png"])
def test_an_estimate_of_images_is_that_of_their_frames(render: Here, tmp_path: Path, name: str) -> None:
    folder = tmp_path / "shot"
    folder.mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f"{1001 + number}.png"), tiny_frame(number))
    assert render(folder / name, "--estimate", "--fps", "25")["frames"] == 3


def test_a_quality_that_the_profile_does_not_have_is_told(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    words = [tiny_clip, "--frames", "0:2", "-o"]
    found = render(*words, tmp_path / "out.mov", "--quality", "5")["warnings"]
    assert "output.quality has no effect: ProRes 422 HQ has one quality." in [one["message"] for one in found]
    for more in (["other.mov"], ["out.mp4", "--quality", "5"]):
        words_of = render(*words, tmp_path / more[0], *more[1:])["warnings"]
        assert not [one for one in words_of if "quality" in one["message"]]


def test_an_explanation_names_tasks_critical_path_and_times_without_rendering(
    render: Here, tiny_clip: Path, tmp_path: Path
) -> None:
    found = render(tiny_clip, "--explain", "--method", "multistyle")
    assert (found["frames"], found["samples"]) == (TINY_FRAMES, 0)
    assert {kind["step"] for kind in found["kinds"]} == {"scan", "paint", "assemble"}
    assert sum(kind["cpu_s"] for kind in found["kinds"]) == pytest.approx(found["cpu_s"], rel=0.01)
    assert [each["processors"] for each in found["durations"]] == [1, 2, 4, 8, 16, 64]
    assert [path.name for path in tmp_path.iterdir() if path.name != "home"] == []


def test_a_folder_of_frames_and_a_still_image_are_accepted_as_inputs(render: Here, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for index in range(3):
        cv2.imwrite(str(tmp_path / "in" / f"{index:04d}.png"), tiny_frame(index)[..., ::-1])
    assert render(tmp_path / "in", "-o", f"{tmp_path}/out/")["frames"] == 3
    odd = tmp_path / os.fsdecode(b"caf\xe9 " + b"x" * 220 + b".png")  # no UTF-8, and long
    odd.write_bytes((tmp_path / "in" / "0000.png").read_bytes())
    render(odd, "-o", tmp_path / "still.png")
    still, first = (cv2.imread(str(tmp_path / name)) for name in ("still.png", "out/0000.png"))
    assert np.array_equal(still, first)


@pytest.mark.parametrize(
    "name",
    [b"~x.png", b"caf\xe9.png", b"\x93\xae.png", b"100% done.png", b"two\nlines.png", b"tab\there.png", b"no_ext",
     b"concat:x.png", b"*.png", b" lead.png", "5.40.12\u202fPM.png".encode(), "e\u0301.png".encode(), b"UP.PNG"],
)  # fmt: skip
def test_files_of_any_name_are_read_and_written(name: bytes, render: Here, tmp_path: Path) -> None:
    source = tmp_path / os.fsdecode(name)
    source.write_bytes(cv2.imencode(".png", tiny_frame(0)[..., ::-1])[1].tobytes())
    suffix = "" if source.suffix.lower() == ".png" else ".png"
    out = tmp_path / f"painted-{source.name}{suffix}"
    assert render(source, "-o", out)["frames"] == 1
    assert cv2.imdecode(np.fromfile(out, np.uint8), cv2.IMREAD_COLOR).shape == tiny_frame(0).shape


def test_frames_of_another_tool_are_steadied(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    (tmp_path / "styled").mkdir()
    for index in range(TINY_FRAMES):
        brightness = 10 * (index % 2)
        cv2.imwrite(str(tmp_path / "styled" / f"{index:04d}.png"), 255 - tiny_frame(index)[..., ::-1] // 2 - brightness)
    render(tiny_clip, "-o", f"{tmp_path}/out/", "-m", "steady", "--input", f"styled={tmp_path / 'styled'}")
    names = [f"{index:04d}.png" for index in range(10, 20)]
    styled, steady = ([cv2.imread(str(tmp_path / at / name)).mean() for name in names] for at in ("styled", "out"))
    assert np.abs(np.diff(steady)).max() < 0.2 * np.abs(np.diff(styled)).mean()


def test_styled_frames_that_do_not_match_the_video_are_refused(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    (tmp_path / "styled").mkdir()
    for index in range(TINY_FRAMES - 1):
        cv2.imwrite(str(tmp_path / "styled" / f"{index:04d}.png"), tiny_frame(index)[..., ::-1])
    words = ("-m", "steady", "--input", f"styled={tmp_path / 'styled'}")
    render(tiny_clip, "-o", f"{tmp_path}/out/", *words, code=2)
    assert f"has {TINY_FRAMES - 1} frames, and 'video' has {TINY_FRAMES}" in render.err


def test_references_parameters_and_artefacts_are_passed_on(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    reference = tmp_path / "red.png"
    cv2.imwrite(str(reference), np.full((64, 64, 3), (30, 30, 220), np.uint8))
    render(tiny_clip, "-o", f"{tmp_path}/plain/", "--param", "lines=off")
    words = ("--param", "lines=off", "--input", f"reference={reference}", "--artefact", "svg")
    output = render(tiny_clip, "-o", f"{tmp_path}/red/", *words)
    before, after = (cv2.imread(str(tmp_path / name / "0005.png")).astype(float) for name in ("plain", "red"))
    assert np.abs(before - after).mean() > 1
    with zipfile.ZipFile(output["artefacts"]["svg"]) as svg:
        assert len(svg.namelist()) == TINY_FRAMES


# -- bad input


@pytest.mark.parametrize(
    ("words", "field", "hint"),
    [
        (["--param", "no_such=1"], "params.no_such", "growing_limit"),
        (["--param", "line=off"], "params.line", "Did you mean 'lines'?"),
        (["--method", "abstracton"], "method", "Did you mean 'abstraction'?"),
        (["--input", "reference=https://example.org/a.png"], "--input reference", "Download it"),
        (["--param", "growing_limit=1e9"], "params.growing_limit", ""),
        (["--param", "growing_limit=NaN"], "params.growing_limit", ""),
        (["--param", "lines"], "--param", "--param sigma_px=1.5"),
        (["--method", "oil"], "method", "abstraction"),
        (["--input", "refrence=x.png"], "--input", "reference"),
        (["--input", "reference=/no/such.png"], "--input reference", "Check the path"),
        (["--method", "analogy", "--input", "style=x.png"], "--input", "Add --input style_output=PATH"),
        (["--artefact", "psd"], "--artefact", "svg"),
    ],
)
def test_bad_arguments_are_refused_with_field_and_remedy(
    render: Here, tiny_clip: Path, tmp_path: Path, words: list[str], field: str, hint: str
) -> None:
    error = render(tiny_clip, "-o", tmp_path / "out.mp4", *words, code=2)["error"]
    assert error["field"] == field
    assert error["remedy"]
    assert hint in error["remedy"]
    assert render.err.startswith("error: ")
    assert len(render.err.splitlines()) == 1
    assert not (tmp_path / "out.mp4").exists()


def test_all_errors_of_a_command_are_reported_together(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    words = ("--param", "line=off", "--param", "growing_limit=1e9")
    error = render(tiny_clip, "-o", tmp_path / "out.mp4", *words, code=2)["error"]
    fields = [error["field"], *(other["field"] for other in error["others"])]
    assert sorted(fields) == ["params.growing_limit", "params.line"]
    assert len(render.err.splitlines()) == 2


@pytest.mark.parametrize(
    "data", [b"", b"MZ this is no video", b"\x00\x00\x00\x18ftypmp42"], ids=["empty", "exe", "cut"]
)
def test_bad_media_are_refused(render: Here, tmp_path: Path, data: bytes) -> None:
    (tmp_path / "clip.mp4").write_bytes(data)
    error = render(tmp_path / "clip.mp4", "-o", tmp_path / "out.mp4", code=2)["error"]
    assert error["code"] in ("unreadable-media", "no-video-stream")
    assert error["remedy"]


# -- outputs


@pytest.mark.parametrize("link", [None, "symlink_to", "hardlink_to"])
def test_the_source_is_never_the_output(render: Here, tiny_clip: Path, tmp_path: Path, link: str | None) -> None:
    clip, out = tmp_path / "clip.mp4", tmp_path / "other.mp4"
    clip.write_bytes(tiny_clip.read_bytes())
    if link is None:
        out = clip
    else:
        getattr(out, link)(clip)
    error = render(clip, "-o", out, "--overwrite", code=2)["error"]
    assert (error["field"], "overwritten" in error["message"]) == ("--output", True)
    assert clip.read_bytes() == tiny_clip.read_bytes()


def test_an_artefact_never_overwrites_an_input_or_the_result(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    for path in (tiny_clip, tmp_path / "out.mp4"):
        words = ("-o", tmp_path / "out.mp4", "--artefact", f"svg={path}", "--overwrite")
        assert render(tiny_clip, *words, code=2)["error"]["field"] == "--artefact svg"


def test_an_existing_output_needs_overwrite(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    out.write_text("mine")
    error = render(tiny_clip, "-o", out, code=2)["error"]
    assert (error["field"], "--overwrite" in error["remedy"]) == ("--output", True)
    assert out.read_text() == "mine"
    render(tiny_clip, "-o", out, "--overwrite")
    assert len(frames_of(out)) == TINY_FRAMES
    assert render(tiny_clip, "-o", out, code=2)["error"]["field"] == "--output"  # that consent was for once


def test_an_existing_artefact_needs_overwrite(render: Here, tiny_clip: Path, tmp_path: Path) -> None:
    (tmp_path / "out-svg.zip").write_text("mine")
    error = render(tiny_clip, "-o", tmp_path / "out.mp4", "--artefact", "svg", code=2)["error"]
    assert error["value"] == str(tmp_path / "out-svg.zip")


@pytest.mark.parametrize(("out", "text"), [("o.png", f"{TINY_FRAMES} frames"), ("/proc/o.mp4", "cannot be written")])
def test_an_impossible_output_is_refused_before_painting(
    render: Here, tiny_clip: Path, tmp_path: Path, out: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("impasto.cli.private_farm.opened", lambda *_: pytest.fail("a farm was opened"))
    error = render(tiny_clip, "-o", tmp_path / out, code=2)["error"]
    assert (error["field"], text in error["message"]) == ("--output", True)


def test_a_full_disk_is_found_before_painting_and_named(
    render: Here, tiny_clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("impasto.cli.private_farm.opened", lambda *_: pytest.fail("a farm was opened"))
    monkeypatch.setattr("impasto.delivery.shutil.disk_usage", lambda _path: type("Usage", (), {"free": 10}))
    error = render(tiny_clip, "-o", tmp_path / "out.mp4", code=1)["error"]
    assert (error["code"], error["value"]) == ("storage-full", str(tmp_path / "out.mp4"))


def test_a_disk_filled_during_delivery_is_named_and_the_render_resumes(
    render: Here, tiny_clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.mp4"

    def full(_from: Path, _to: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "/elsewhere")

    with monkeypatch.context() as patched:
        patched.setattr("impasto.delivery.shutil.copyfile", full)
        error = render(tiny_clip, "-o", out, code=1)["error"]
    assert (error["code"], error["value"]) == ("storage-full", str(out))
    assert render(tiny_clip, "-o", out)["frames"] == TINY_FRAMES
    assert "Resuming at" in render.err


# -- interrupted


@pytest.fixture(scope="module")
def long_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip long enough to be several tasks."""
    path = tmp_path_factory.mktemp("long") / "long.mp4"
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", rate=24, options={"crf": "16"})
        video.width, video.height, video.pix_fmt = *LONG_SIZE, "yuv420p"
        for index in range(LONG_FRAMES):
            frame = cv2.resize(tiny_frame(abs(index % 60 - 30)), LONG_SIZE)
            out.mux(video.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(video.encode(None))
    return path


@pytest.fixture(scope="module")
def whole(long_clip: Path) -> bytes:
    """The result of an undisturbed render of the long clip by two workers."""
    out = long_clip.with_name("whole.mp4")
    assert run(["render", str(long_clip), "-o", str(out), "--workers", "2", "--home", f"{out}.home", "--quiet"]) == 0
    return out.read_bytes()


def stop_while_painting(command: list[str], how: signal.Signals) -> tuple[int, str]:
    """Start a render, send `how` as soon as its first step is done; exit status and stderr."""
    pipe = subprocess.PIPE
    with started(command, stdout=pipe, stderr=pipe, text=True, preexec_fn=_heed_interrupts) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "succeeded" in line:
                break
        process.send_signal(how)
        rest = process.stderr.read()
        return process.wait(timeout=60), rest


def _heed_interrupts() -> None:
    """Restore default signal handlers: a shell ignores these signals in background jobs, and children inherit that."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_repeated_command_resumes_to_the_same_bytes(
    render: Here, long_clip: Path, whole: bytes, tmp_path: Path, how: signal.Signals
) -> None:
    out = tmp_path / "out.mp4"
    status, output = stop_while_painting(impasto(long_clip, "-o", out, "--json", home=render.home), how)
    assert not out.exists()
    assert status == (130 if how == signal.SIGINT else -signal.SIGKILL)
    if how == signal.SIGINT:
        assert "error: Interrupted at" in output
        assert "Run the same command again" in output
    assert render(long_clip, "-o", out)["frames"] == LONG_FRAMES
    assert "Resuming at" in render.err
    assert out.read_bytes() == whole


@pytest.mark.parametrize("frames", ["#1002-#1005", "1:5"])
def test_a_range_of_images_counts_with_the_options_of_their_sequence(render: Here, tmp_path: Path, frames: str) -> None:
    (tmp_path / "shot").mkdir()
    for number in (1001, 1002, 1004, 1005, 1006):
        cv2.imwrite(str(tmp_path / "shot" / f"{number}.png"), tiny_frame(number - 1001))
    render(tmp_path / "shot", "-o", f"{tmp_path}/out/", "--missing", "hold", "--frames", frames)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [f"{n}.png" for n in range(1002, 1006)]
