"""Previews: one stylised frame of a job that is not submitted."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.analogy import Analogy
from pipeline.methods.base import InputSpec, Method, Params
from pipeline.methods.patches import Patches
from pipeline.video.stills import encode_png
from tests.conftest import tiny_frame
from workers.blobs.disk import DiskBlobs
from workers.contract.record import Asset, asset_key
from workers.contract.request import JobRequest
from workers.previews import painting, single
from workers.previews.byte_cache import ByteCache
from workers.previews.single import PreviewAsk, PreviewJob, frame_png
from workers.previews.warm import WarmFrames


class Last(Method):
    """A method whose red channel is the number of processed frames, and whose green channel is the reference's."""

    name = "last"
    Params = Params
    inputs = (
        InputSpec("video", "video", True, "", ""),
        InputSpec("style", "image", False, "", ""),
        InputSpec("keyframes", "images", False, "", "", preview=False),
    )

    def stream(
        self, params: Any, size: tuple[int, int], seed: int, references: Mapping[str, Iterator[Frame]]
    ) -> Last | None:
        self.calls, self.size = 0, size
        self.green = int(next(references["style"])[0, 0, 1]) if "style" in references else 0
        return self if seed == 0 else None

    def step(self, frame: Frame) -> Frame:
        assert (frame.shape[1], frame.shape[0]) == self.size
        self.calls += 1
        return np.full_like(frame, (self.calls, self.green, frame[frame.shape[0] * 40 // 64, frame.shape[1] // 6, 0]))


def asset(name: str) -> Asset:
    return Asset(f"ast_{name}", name, 1, name, "video/mp4", "video", {}, 0.0)


class Previews:
    """Previews of jobs with blobs of a folder."""

    def __init__(self, blobs: DiskBlobs) -> None:
        self._blobs, self._frames = blobs, WarmFrames(blobs, ByteCache(1 << 24))
        self.close = self._frames.close

    def png(self, request: JobRequest, assets: Mapping[str, Asset], ask: PreviewAsk) -> bytes:
        return frame_png(PreviewJob(request, assets, ask), self._frames, self._blobs, lambda: None)


@pytest.fixture
def previews(home: Path, tiny_clip: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Previews]:
    blobs = DiskBlobs(home)
    blobs.put(asset_key("ast_video"), tiny_clip)
    blobs.put(asset_key("ast_style"), encode_png(np.full((32, 32, 3), (0, 77, 0), np.uint8)))
    for module in (single, painting):
        monkeypatch.setattr(module, "method", lambda name: Last() if name == "last" else method(name))
    made = Previews(blobs)
    yield made
    made.close()


def shown(previews: Previews, frame: int, side: int = 640, seed: int = 0, names: tuple[str, ...] = ("video",)) -> Frame:
    assets = {name: asset(name) for name in names}
    request = JobRequest("last", {name: a.id for name, a in assets.items()}, seed=seed)
    data = previews.png(request, assets, PreviewAsk(frame, side))
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1], np.uint8)


def test_a_preview_frame_is_rendered_after_its_two_predecessors(previews: Previews) -> None:
    assert shown(previews, 10).shape == (64, 96, 3)
    assert shown(previews, 10)[0, 0, 0] == 3
    assert shown(previews, 0)[0, 0, 0] == 1
    assert abs(int(shown(previews, 0)[0, 0, 2]) - int(tiny_frame(0)[40, 16, 0])) < 12
    assert np.array_equal(shown(previews, 500), shown(previews, 23))


def test_a_preview_is_scaled_to_the_requested_side(previews: Previews) -> None:
    assert shown(previews, 3, side=48).shape == (32, 48, 3)


def test_preview_references_reach_the_method(previews: Previews) -> None:
    assert shown(previews, 3, names=("video", "style"))[0, 0, 1] == 77


@pytest.mark.parametrize("chosen", [Patches(), Analogy()])
def test_a_whole_film_method_previews_a_single_frame(home: Path, previews: Previews, chosen: Method) -> None:
    whole = Previews(DiskBlobs(home))
    request = JobRequest(chosen.name, {"video": "ast_video"})
    shots = [whole.png(request, {"video": asset("video")}, PreviewAsk(at, 48)) for at in (3, 3, 20)]
    whole.close()
    painted = cv2.imdecode(np.frombuffer(shots[0], np.uint8), cv2.IMREAD_COLOR)
    assert painted.shape == (32, 48, 3) and painted.std() > 5
    assert shots[0] == shots[1] != shots[2]


def test_reference_images_are_scaled_with_the_frame(previews: Previews, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: dict[str, Any] = {}

    def painted(
        chosen: Any, params: Any, seed: int, video: Any, inputs: Any, check: Any
    ) -> Iterator[tuple[int, Frame]]:
        calls.update({name: pictures[0] for name, pictures in inputs.items()}, video=video[0])
        yield 0, video[0]

    monkeypatch.setattr(painting, "painted", painted)
    shown(previews, 3, side=48, seed=1, names=("video", "style"))
    assert {name: picture.shape for name, picture in calls.items()} == {"video": (32, 48, 3), "style": (16, 16, 3)}


def test_a_single_frame_preview_refuses_keyframes(previews: Previews) -> None:
    with pytest.raises(BadParameter) as caught:
        shown(previews, 3, seed=1, names=("video", "keyframes"))
    assert caught.value.field == "inputs.keyframes"


def test_a_method_without_designs_refuses_one(previews: Previews) -> None:
    request = JobRequest("last", {"video": "ast_video"})
    with pytest.raises(BadParameter) as caught:
        previews.png(request, {"video": asset("video")}, PreviewAsk(3, 640, documents={"design": {"version": 1}}))
    assert caught.value.field == "design"


# -- with a design


@pytest.fixture
def painter(home: Path, tiny_clip: Path) -> Iterator[Previews]:
    blobs = DiskBlobs(home)
    blobs.put(asset_key("ast_video"), tiny_clip)
    masks = np.zeros((64, 96), np.uint8)
    masks[:, :48] = 1
    blobs.put(asset_key("ast_masks"), encode_png(np.dstack([masks] * 3)))
    blobs.put("found", found_regions())
    made = Previews(blobs)
    yield made
    made.close()


def found_regions() -> bytes:
    """Tube 300 (object 2) in the upper half, tube 1 (object 1) in the lower, in frames 0 to 9."""
    number = np.where(np.arange(64)[:, None] < 32, 300, 1) + np.zeros((64, 96), int)
    coded = encode_png(np.dstack([number >> 16, number >> 8 & 255, number & 255]).astype(np.uint8))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(
            "regions-list.json", json.dumps({"tubes": [{"tube": 1, "object": 1}, {"tube": 300, "object": 2}]})
        )
        for frame in range(10):
            archive.writestr(f"tubes-{frame:07d}.png", coded)
    return out.getvalue()


def sketched(
    painter: Previews, design: Any, regions: str | None = "found", names: tuple[str, ...] = ("video",)
) -> Frame:
    assets = {name: asset(name) for name in names}
    request = JobRequest("multistyle", {name: a.id for name, a in assets.items()})
    data = painter.png(
        request,
        assets,
        PreviewAsk(
            5, 640, {} if design is None else {"design": design}, {} if regions is None else {"regions": regions}
        ),
    )
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1], np.uint8)


def keyed(region: dict[str, Any]) -> dict[str, Any]:
    """A design that changes the colours of region "it" only."""
    keys = [{"region": "it", "set": {"hue": 180, "value": -0.3}}, {"region": "rest"}]
    return {"version": 1, "regions": {"it": region}, "keys": keys}


@pytest.mark.parametrize("region", [{"tubes": [300]}, {"objects": [2]}])
def test_a_design_is_previewed_with_the_regions_of_a_job(painter: Previews, region: dict[str, Any]) -> None:
    plain, designed = sketched(painter, None), sketched(painter, keyed(region))
    change = np.abs(plain.astype(int) - designed).mean(axis=(1, 2))
    assert change[:24].min() > 8 and change[40:].mean() < 4


def test_label_maps_apply_to_the_frames_around_them(painter: Previews) -> None:
    plain = sketched(painter, None)
    designed = sketched(painter, keyed({"label": 1}), None, ("video", "masks"))
    change = np.abs(plain.astype(int) - designed).mean(axis=(0, 2))
    assert change[:40].min() > 8 and change[60:].mean() < 4


def test_a_bad_design_is_refused_with_its_path(painter: Previews) -> None:
    with pytest.raises(BadParameter) as caught:
        sketched(painter, {"version": 1, "keys": [{"region": "rest", "frame": 900}]})
    assert caught.value.field == "inputs.design.keys[0].frame"
