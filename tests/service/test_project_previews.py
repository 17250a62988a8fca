"""Previews of a project over HTTP: records, passes, cards, errors by path, overtaking, bounded memory."""

from __future__ import annotations

import base64
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from numpy.typing import NDArray

from pipeline.methods import method
from pipeline.methods.analogy import propagation as propagation_module
from pipeline.methods.local import LocalContext, run_plan
from pipeline.synthesis.images import NOWHERE
from service.app import create_app
from service.settings import Settings
from tests.e2e.pages import make_two_shots
from tests.service.records import picture, records, types
from tests.workers.projects.documents import layer
from workers.farm import Farm, open_farm
from workers.previews.film import PreviewFilm
from workers.previews.kinds import matte as matte_module
from workers.previews.model import PreviewQuery
from workers.previews.service import PreviewRun, PreviewService

Json = dict[str, Any]


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(Settings(home=tmp_path_factory.mktemp("home"), pool="none"))
    yield opened
    opened.stop()


@pytest.fixture(scope="module")
def client(farm: Farm, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    app = create_app(Settings(home=tmp_path_factory.mktemp("service"), pool="none"), farm)
    with TestClient(app, "http://127.0.0.1:8420", raise_server_exceptions=False) as opened:
        yield opened


@pytest.fixture(scope="module")
def clip(client: TestClient, tiny_clip: Path) -> str:
    return str(client.post("/v1/assets", files={"file": ("tiny.mp4", tiny_clip.read_bytes())}).json()["id"])


def _document(clip: str, *layers: Json) -> Json:
    return {
        "schema": 2,
        "name": "Swan",
        "assets": {"clip": {"id": clip}},
        "shots": [{"id": "s1", "video": "clip", "layers": list(layers)}],
    }


@pytest.fixture(scope="module")
def at(client: TestClient, clip: str) -> str:
    made = client.post("/v1/projects", json={"document": _document(clip, layer("multistyle"))})
    return f"{made.json()['links']['self']}/previews"


def _ask(http: TestClient, url: str, **body: Any) -> Any:
    answer = http.post(url, json={"shot": "s1", **body})
    assert answer.status_code == 200, answer.text
    assert answer.headers["Content-Type"] == "application/vnd.impasto.records"
    found = records(answer.content)
    if url.endswith("/paint"):  # whether painting tells its progress depends on the load of the machine
        return [record for record in found if record[0]["type"] != "progress"]
    return found


def test_the_source_preview_is_served_frame_by_frame(client: TestClient, at: str) -> None:
    found = _ask(client, f"{at}/source", frames=[2, 9], step=3, max_side_px=48)
    assert types(found) == ["begin", "frame", "frame", "frame", "end"]
    assert [header["frame"] for header, _ in found[1:-1]] == [2, 5, 8]
    assert picture(found[1][1]).shape == (32, 48, 3)
    assert found[1][0]["scale"] == 0.5


@pytest.mark.parametrize("damage", ["missing", "shortened"])
@pytest.mark.parametrize("what", ["source", "paint", "regions", "cuts"])
def test_a_preview_of_a_lost_file_ends_with_an_error_record(
    client: TestClient, farm: Farm, tmp_path: Path, damage: str, what: str
) -> None:
    film = make_two_shots(tmp_path / "film.mp4", 24)
    film.write_bytes(film.read_bytes() + f"{damage} {what}".encode())
    asset = str(client.post("/v1/assets", files={"file": ("film.mp4", film.read_bytes())}).json()["id"])
    made = client.post("/v1/projects", json={"document": _document(asset, layer("multistyle"))}).json()
    key = farm.assets.file(asset, "").key
    with farm.blobs.local(key) as stored:
        data = stored.read_bytes()
    farm.blobs.delete(key)
    if damage == "shortened":
        film.write_bytes(data[: len(data) // 3])
        farm.blobs.put(key, film)
    found = _ask(client, f"{made['links']['self']}/previews/{what}")
    assert types(found)[-1] == "error"
    shown = found[-1][0]["problem"]
    assert (shown["status"] < 500 or shown["code"] == "damaged-storage") and shown["remedy"], shown


@pytest.mark.parametrize("method", ["abstraction", "multistyle", "patches"])
def test_every_method_paints_a_frame(client: TestClient, at: str, clip: str, method: str) -> None:
    found = _ask(client, f"{at}/paint", frame=5, document=_document(clip, layer(method)))
    assert types(found) == ["begin", "frame", "end"], "no draft of a film that is painted soon"
    assert (found[1][0]["final"], found[1][0]["media_type"]) == (True, "image/png")
    assert picture(found[1][1]).shape == (64, 96, 3)


def test_a_preview_that_takes_long_begins_with_a_draft(
    client: TestClient, at: str, clip: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workers.previews.kinds.paint.DRAFT_FROM_PIXELS", 0)
    monkeypatch.setattr("workers.previews.kinds.paint.DRAFT_SIDE_PX", 48)
    found = _ask(client, f"{at}/paint", frame=5)
    assert [(header["pass"], header["width"]) for header, _ in found[1:-1]] == [(0, 48), (1, 96)]


def test_the_preview_of_a_change_is_the_preview_of_the_changed_document(client: TestClient, at: str, clip: str) -> None:
    change = [{"op": "add", "path": "/shots/0/layers/0/params", "value": {"style": "pointillism"}}]
    changed = _ask(client, f"{at}/paint", frame=5, change=change)[1][1]
    document = _document(clip, layer("multistyle", params={"style": "pointillism"}))
    assert changed == _ask(client, f"{at}/paint", frame=5, document=document)[1][1]
    assert changed != _ask(client, f"{at}/paint", frame=5)[1][1]


def test_a_range_preview_of_a_causal_method_matches_its_stream(client: TestClient, at: str, clip: str) -> None:
    found = _ask(client, f"{at}/paint", frames=[0, 4], document=_document(clip, layer("abstraction")))
    assert [header["frame"] for header, _ in found[1:-1]] == [0, 1, 2, 3]


def test_a_crop_is_cut_from_the_frame_at_full_resolution(client: TestClient, at: str) -> None:
    whole = picture(_ask(client, f"{at}/paint", frame=5)[1][1])
    found = _ask(client, f"{at}/paint", frame=5, crop=[10, 20, 30, 16], max_side_px=32)
    assert np.array_equal(picture(found[1][1]), whole[20:36, 10:40])


def test_layers_are_composited(client: TestClient, at: str, clip: str) -> None:
    below, above = layer("abstraction"), {**layer("multistyle"), "id": "l2"}

    def painted(*layers: Json) -> Any:
        found = _ask(client, f"{at}/paint", frame=5, document=_document(clip, *layers))
        return picture(found[1][1]).astype(np.int64)

    a, b = painted(below), painted(above)
    both = painted(below, {**above, "opacity": 0.5, "blend": "multiply"})
    assert np.abs(both - (0.5 * a * b / 255 + 0.5 * a)).max() <= 0.51
    assert np.array_equal(painted(below, {**above, "visible": False}), a)


def test_style_cards_show_the_frame_in_every_style(client: TestClient, at: str) -> None:
    cards = [{"id": name, "set": {"params": {"style": name}}} for name in ("pointillism", "watercolor")]
    found = _ask(client, f"{at}/styles", frame=5, cards=cards, max_side_px=64)
    assert [header["card"] for header, _ in found[1:-1]] == ["pointillism", "watercolor"]
    assert found[1][1] != found[2][1]


@pytest.fixture
def red_key(client: TestClient, at: str) -> NDArray[np.uint8]:
    """Frame 6 with reduced blue and green, BGR."""
    key = picture(_ask(client, f"{at}/source", frame=6)[1][1])
    key[..., :2] //= 4
    return key


@pytest.fixture
def propagation(client: TestClient, at: str, clip: str) -> Callable[..., dict[int, NDArray[np.uint8]]]:
    """The pictures by frame, in the order of the records, for a painting of frame 6."""

    def ask(key: NDArray[np.uint8], **params: Any) -> dict[int, NDArray[np.uint8]]:
        image = base64.b64encode(cv2.imencode(".png", key)[1].tobytes()).decode()
        document = _document(clip, layer("analogy", params={"levels": 2, "iterations": 2, **params}))
        found = _ask(client, f"{at}/propagate", key=6, around=2, image=image, max_side_px=96, document=document)
        assert types(found)[-1] == "end"
        return {header["frame"]: picture(payload) for header, payload in found[1:-1]}

    return ask


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Number of pixels that the propagator searches for each frame; empty if it is not called."""
    counts: list[int] = []
    plain = propagation_module._Neighbourhood.fixed_offsets

    def counted(self: Any, index: int) -> Any:
        fixed = plain(self, index)
        counts.append(96 * 64 if fixed is None else int((fixed[..., 0] <= NOWHERE).sum()))
        return fixed

    monkeypatch.setattr(propagation_module._Neighbourhood, "fixed_offsets", counted)
    return counts


Ask = Callable[..., dict[int, NDArray[np.uint8]]]


def test_a_painted_keyframe_affects_neighbouring_frames(
    red_key: NDArray[np.uint8], propagation: Ask, searched: list[int]
) -> None:
    shown = propagation(red_key)
    assert list(shown) == [6, 7, 5, 8, 4] and searched, "the propagator made them"
    assert np.array_equal(shown[6], red_key), "the key is matched exactly"
    palette = {tuple(pixel) for pixel in red_key.reshape(-1, 3).tolist()}
    assert all({tuple(pixel) for pixel in colours.reshape(-1, 3).tolist()} <= palette for colours in shown.values())


def test_a_key_under_the_pen_has_its_own_mask_also_while_the_document_has_an_older_one(
    client: TestClient, at: str, clip: str, red_key: NDArray[np.uint8]
) -> None:
    cut = np.dstack([red_key, np.zeros((64, 96), np.uint8)])
    cut[:, :48, 3] = 255
    cut[:, 48:, :3] = 0  # transparent pixels of a page are black
    document = _document(clip, layer("analogy", params={"levels": 2, "iterations": 2}, keys=[
        {"frame": 6, "image": "key", "mask": "white"}]))  # fmt: skip
    for name, value in (("key", red_key), ("white", np.full((64, 96), 255, np.uint8))):
        files = {"file": (f"{name}.png", cv2.imencode(".png", value)[1].tobytes())}
        document["assets"][name] = {"id": client.post("/v1/assets", files=files).json()["id"]}
    image = base64.b64encode(cv2.imencode(".png", cut)[1].tobytes()).decode()
    found = _ask(client, f"{at}/propagate", key=6, around=1, image=image, max_side_px=96, document=document)
    shown = {header["frame"]: picture(payload) for header, payload in found[1:-1]}
    plain = picture(_ask(client, f"{at}/source", frame=6, max_side_px=96)[1][1])
    assert np.array_equal(shown[6][:, :48], red_key[:, :48]) and np.array_equal(shown[6][:, 48:], plain[:, 48:])


def test_a_second_edit_recomputes_only_the_changed_region(
    red_key: NDArray[np.uint8], propagation: Ask, searched: list[int]
) -> None:
    before = propagation(red_key, steadiness=2)
    assert sum(searched) == 4 * 96 * 64, "all of four frames; the key itself is not searched"
    searched.clear()
    edited = cv2.circle(red_key.copy(), (20, 20), 5, (255, 0, 255), -1)
    after = propagation(edited, steadiness=2)
    assert 0 < sum(searched) < 96 * 64, "less than a quarter of four frames"
    assert all((before[frame] != after[frame]).any() for frame in (4, 5, 7, 8))


def test_transparent_pixels_of_a_key_show_the_frame(
    client: TestClient, at: str, red_key: NDArray[np.uint8], propagation: Ask
) -> None:
    filmed = picture(_ask(client, f"{at}/source", frame=6, max_side_px=96)[1][1])
    opacity = np.zeros((64, 96), np.uint8)
    opacity[:, :50] = 255
    shown = propagation(np.dstack([red_key, opacity]), steadiness=3)[6]
    assert np.array_equal(shown[:, :50], red_key[:, :50]) and np.array_equal(shown[:, 50:], filmed[:, 50:])


@pytest.mark.parametrize("fails", [False, True])
def test_without_a_propagator_the_plan_renders_the_frames(
    red_key: NDArray[np.uint8], propagation: Ask, monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    def none(*_: Any) -> None:
        if fails:
            raise ValueError("no")

    monkeypatch.setattr("pipeline.methods.analogy.Analogy.propagator", none)
    shown = propagation(red_key, levels=1, iterations=1 + fails)
    assert list(shown) == [6, 5, 7, 4, 8] and np.array_equal(shown[6], red_key)


def test_regions_have_the_numbers_of_a_job_and_reach_the_preview(client: TestClient, at: str, clip: str) -> None:
    found = _ask(client, f"{at}/regions", frame=5, max_side_px=96)
    assert set(types(found)[1:-3]) == {"progress"} and types(found)[-3:] == ["map", "regions", "end"]
    coded = picture(found[-3][1]).astype(np.int64)
    numbers = coded[..., 2] << 16 | coded[..., 1] << 8 | coded[..., 0]
    tubes = found[-2][0]["tubes"]
    assert {str(number) for number in np.unique(numbers).tolist()} - {"0"} == set(tubes)
    tube, row = max(tubes.items(), key=lambda item: int(item[1]["area"]))
    assert row["area"] == np.count_nonzero(numbers == int(tube))
    assert int(tube) in found[-2][0]["objects"][str(row["object"])]["tubes"]
    assert types(_ask(client, f"{at}/regions", frame=6, max_side_px=96)) == ["begin", "map", "regions", "end"], "warm"
    keys = [{"region": "a", "style": "pointillism", "frame": 0}]
    designed = layer("multistyle", design={"regions": {"a": {"tubes": [int(tube)]}}, "keys": keys})
    plain = _ask(client, f"{at}/paint", frame=5)[1][1]
    assert _ask(client, f"{at}/paint", frame=5, document=_document(clip, designed))[1][1] != plain


def test_directions_follow_the_design(client: TestClient, at: str, clip: str) -> None:
    along = [{"region": "rest", "frame": 0, "edge_weight": 0.0,
              "elements": [{"pattern": "regular", "at": [0.5, 0.5], "angle": 30}]}]  # fmt: skip
    document = _document(clip, layer("multistyle", design={"directions": along}))
    header, payload = _ask(client, f"{at}/directions", frame=5, spacing_px=8, document=document)[1]
    field = np.frombuffer(payload, "<f4").reshape(header["rows"], header["columns"], 2)
    assert (header["rows"], header["columns"]) == (8, 12)
    assert np.abs(np.rad2deg(field[..., 0]) - 30).max() < 1 and field[..., 1].min() > 0.5


def test_suggested_keyframes_begin_with_the_first_frame(client: TestClient, at: str) -> None:
    found = _ask(client, f"{at}/keys", count=3)
    scores, keys = found[-3][0], found[-2][0]
    assert scores["frames"] == [0, 24] and len(scores["occlusion"]) == 24
    assert keys["frames"][0] == 0 and len(keys["frames"]) == 3


def test_cuts_are_those_of_a_job(client: TestClient, at: str, tmp_path: Path) -> None:
    data = make_two_shots(tmp_path / "two.mp4", 60).read_bytes()
    video = client.post("/v1/assets", files={"file": ("two.mp4", data)}).json()["id"]
    document = _document(video, layer("abstraction"))
    found = _ask(client, f"{at}/cuts", document=document)
    assert types(found) == ["begin", "progress", "progress", "cuts", "end"]
    assert [header["cuts"] for header, _ in found[1:-1]] == [[], [30], [30]]
    assert [header["done"] for header, _ in found[1:-2]] == [0.4, 0.8]
    again = _ask(client, f"{at}/cuts", document=document)
    assert types(again) == ["begin", "cuts", "end"] and again[1][0]["cuts"] == [30]
    blind = _document(video, layer("abstraction", params={"cut_sensitivity": 0}))
    assert _ask(client, f"{at}/cuts", document=blind)[-2][0]["cuts"] == []


def test_layer_problems_are_refused_with_their_path(client: TestClient, at: str, clip: str) -> None:
    wrong = _document(clip, layer("multistyle", params={"stroke_size": 9}), {**layer("oil"), "id": "l2"})
    refused = client.post(f"{at}/paint", json={"shot": "s1", "layer": "l1", "document": wrong})
    assert refused.status_code == 422
    assert [error["path"] for error in refused.json()["errors"]] == ["/shots/0/layers/0/params/stroke_size"]
    other = client.post(f"{at}/paint", json={"shot": "s1", "layer": "l2", "document": wrong})
    assert [error["path"] for error in other.json()["errors"]] == ["/shots/0/layers/1/method"]
    assert client.post(f"{at}/paint", json={"shot": "s9"}).status_code == 404


def test_a_later_preview_request_cancels_the_earlier_one(
    client: TestClient, at: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    painting, second_arrived = threading.Event(), threading.Event()
    paint, start = PreviewFilm.frames, PreviewService.start

    def paint_slowly(self: PreviewFilm, *wanted: Any) -> Any:
        painting.set()
        assert second_arrived.wait(60)
        return paint(self, *wanted)

    def start_and_tell(self: PreviewService, query: PreviewQuery, owner: str = "") -> PreviewRun:
        run = start(self, query, owner)
        if query.seq == 2:
            second_arrived.set()
        return run

    monkeypatch.setattr(PreviewFilm, "frames", paint_slowly)
    monkeypatch.setattr(PreviewService, "start", start_and_tell)
    answers: dict[int, list[str]] = {}

    def ask(seq: int) -> None:
        answers[seq] = types(_ask(client, f"{at}/paint", frame=7 + seq, client="tab", seq=seq))

    first = threading.Thread(target=ask, args=(1,))
    first.start()
    assert painting.wait(60)
    second = threading.Thread(target=ask, args=(2,))
    second.start()
    first.join(60)
    second.join(60)
    assert answers[1][-1] == "overtaken" and answers[2] == ["begin", "frame", "end"]
    assert types(_ask(client, f"{at}/paint", frame=8, client="tab", seq=1)) == ["begin", "overtaken"], "it is late"


def test_cached_preview_state_is_bounded(client: TestClient, at: str) -> None:
    state = client.get(f"{at}/state").json()
    assert 0 < state["bytes"] <= state["limit_bytes"] and state["where"] == "process"


def test_flicker_is_mapped_in_one_frame_and_measured_in_several(client: TestClient, at: str, clip: str) -> None:
    document = _document(clip, layer("abstraction"))
    one = _ask(client, f"{at}/flicker", frame=5, document=document)
    assert types(one) == ["begin", "frame", "flicker", "end"]
    header, heat = one[2]
    assert header["flicker"] > 0 and header["error"] > 0
    assert picture(heat).shape[:2] == picture(one[1][1]).shape[:2]
    several = _ask(client, f"{at}/flicker", frames=[4, 7], document=document)[1:-1]
    assert [found["frame"] for found, _ in several] == [5, 6] and not any(data for _, data in several)
    (first, _), _end = _ask(client, f"{at}/flicker", frame=0, document=document)[1:]
    assert (first["frame"], first["flicker"]) == (0, None), "the first frame follows no other"
    refused = client.post(f"{at}/flicker", json={"shot": "s1", "frames": [0, 90]})
    assert (refused.status_code, refused.json()["field"]) == (422, "frames")


def test_clusters_before_a_film_are_those_of_a_job(client: TestClient, at: str, clip: str) -> None:
    document = _document(clip, layer("patches"))
    found = [one for one in _ask(client, f"{at}/clusters", document=document) if one[0]["type"] == "clusters"]
    frames = [header["frame"] for header, _ in found]
    assert frames == list(range(len(frames))) and len(frames) > 2
    source = [picture(data)[..., ::-1].copy() for header, data in
              _ask(client, f"{at}/source", frames=[0, len(frames)])[1:-1]]  # fmt: skip
    chosen = method("patches")
    context = LocalContext(chosen.Params(), source)
    run_plan(chosen, context)
    for header, data in found:
        number = header["frame"]
        expected = context.kept["cluster", f"run-{number // 12 * 12:07d}"][f"labels-{number}"]
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert decoded is not None and decoded.dtype == np.uint16 and np.array_equal(decoded, expected)
        assert set(header["uncertainty"]) == {str(label) for label in np.unique(expected) if label}
    again = _ask(client, f"{at}/clusters", document=document)[1:-1]
    assert again == found, "they are kept"
    refused = _ask(client, f"{at}/clusters", document=_document(clip, layer("analogy")))
    assert "patches" in refused[-1][0]["problem"]["remedy"]


def test_the_object_that_is_clicked_is_a_mask(client: TestClient, at: str, clip: str) -> None:
    document = _document(clip, layer("abstraction"))
    ((header, data),) = _ask(client, f"{at}/object", frame=4, box=[0.5, 0.5, 0.5, 0.5], document=document)[1:-1]
    mask = picture(data)
    assert (header["type"], header["frame"]) == ("mask", 4)
    assert mask.shape[:2] == (header["height"], header["width"]) and 0 < (mask > 0).mean() < 1
    refused = client.post(f"{at}/object", json={"shot": "s1", "frame": 0, "box": [0, 0, 2, 1]})
    assert refused.status_code == 422 and refused.json()["field"].startswith("box")


def test_scribbles_are_spread_to_the_frames_after_them(client: TestClient, at: str, clip: str) -> None:
    scribble = np.full((64, 96, 4), (128, 128, 128, 0), np.uint8)
    scribble[:, 60:] = (0, 0, 0, 255)
    scribble[:, :30] = (255, 255, 255, 255)
    png = cv2.imencode(".png", scribble)[1].tobytes()
    image = client.post("/v1/assets", files={"file": ("scribble.png", png)}).json()["id"]
    document = _document(clip, layer("patches", scribbles=[{"frame": 2, "image": "scribble"}]))
    document["assets"]["scribble"] = {"id": image}
    found = _ask(client, f"{at}/spread", frame=3, around=2, document=document)[1:-1]
    assert [header["frame"] for header, _ in found] == [3, 4, 5]
    for _, data in found:
        mask = picture(data)
        assert mask[:, :10].mean() > 200 and mask[:, 80:].mean() < 50
    assert types(_ask(client, f"{at}/spread", frame=1, document=document)) == ["begin", "end"]
    document["shots"][0]["layers"][0]["parts"]["scribbles"].append({"frame": 20, "image": "scribble"})
    more = _ask(client, f"{at}/spread", frame=3, around=2, document=document)
    assert types(more) == ["begin", "mask", "mask", "mask", "end"], "scribbles of a later frame are left out"


def test_a_clicked_object_is_followed_through_the_wanted_frames(
    client: TestClient, at: str, clip: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    click = {"frame": 4, "box": [0.25, 0.62, 0.25, 0.62]}
    found = _ask(client, f"{at}/matte", frames=[2, 9], marks=[click])
    masks = {header["frame"]: picture(body) for header, body in found if header["type"] == "mask"}
    assert sorted(masks) == list(range(2, 9)), "each once, in any order"
    assert all(mask.shape[:2] == (64, 96) for mask in masks.values()) and masks[4].max() == 255
    assert found[-2][0] == {"type": "progress", "done": 1.0, "note": "Following the object", "bytes": 0}
    erased = _ask(client, f"{at}/matte", frames=[2, 9], marks=[click, {**click, "erase": True}])
    assert all(picture(body).max() == 0 for header, body in erased if header["type"] == "mask")
    monkeypatch.setattr(matte_module, "MOST_PIXELS", 96 * 64 * 5)
    refused = _ask(client, f"{at}/matte", marks=[click])
    assert refused[-1][0]["problem"]["field"] == "frames" and "at most 5 frames" in refused[-1][0]["problem"]["remedy"]
    assert client.post(f"{at}/matte", json={"shot": "s1", "marks": []}).status_code == 422
