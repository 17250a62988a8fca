"""The editable form of painted keys: projects that were stored before it had groups and masks stay as they are."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.methods.parts import PaintedKey
from tests.workers.projects.documents import document, layer
from workers.projects.document import Document
from workers.projects.faults import BadProject
from workers.projects.materials import ImagesByFrame, JsonValue
from workers.projects.parsing import parse_document
from workers.projects.submissions import submissions

STORED = {
    "frame": 12, "image": "key-12", "mask": "mask-12", "ui": {"seen": True},
    "paint": {"layers": [
        {"id": "frame", "name": "Video frame", "opacity": 1, "visible": True},
        {"id": "paint", "name": "Paint", "image": "map-0", "strokes": "fg-0", "opacity": 0.5, "blend": "multiply"},
    ]},
}  # fmt: skip
"""A key as versions before groups, masks and modes have stored it."""
PRESENT = {
    "frame": 12, "image": "key-12", "before": 3, "after": 5, "weight": 2.5,
    "paint": {
        "layers": [
            {"id": "low", "parent": "g", "strokes": "fg-0"},
            {"id": "top", "parent": "g", "image": "map-0", "mask": "mask-12", "clip": True, "locked": True,
             "blend": "hue"},
            {"id": "g", "group": True, "blend": "pass-through", "opacity": 0.4},
        ],
        "mask": {"id": "mask", "strokes": "wave"},
    },
}  # fmt: skip


def parsed(*keys: dict[str, Any]) -> Document:
    return parse_document(document(layer("analogy", keys=list(keys))))


def key_of(read: Document) -> PaintedKey:
    key = read.shots[0].layers[0].parts["keys"][0]  # type: ignore[index]
    assert isinstance(key, PaintedKey)
    return key


def test_a_stored_key_is_read_unchanged_and_gives_the_same_job() -> None:
    read = parsed(STORED)
    key = key_of(read)
    assert key.model_dump(exclude_unset=True) == {**STORED, "paint": {"layers": tuple(STORED["paint"]["layers"])}}
    assert (key.before, key.after, key.weight) == (None, None, 1.0)
    assert [(one.clip, one.group, one.parent, one.mask) for one in key.paint.layers] == [(False, False, None, None)] * 2
    (job,) = submissions(read)
    assert set(job.inputs) == {"video", "keyframes", "masks"}, "no settings are given"


def test_a_present_key_names_all_its_assets_and_gives_its_settings_to_the_job() -> None:
    read = parsed(PRESENT)
    assert dict(key_of(read).assets()) == {
        ("image",): "key-12", ("paint", "layers", 0, "strokes"): "fg-0", ("paint", "layers", 1, "image"): "map-0",
        ("paint", "layers", 1, "mask"): "mask-12", ("paint", "mask", "strokes"): "wave",
    }  # fmt: skip
    (job,) = submissions(read)
    assert job.inputs["keyframe_settings"] == JsonValue.of([{"frame": 12, "before": 3, "after": 5, "weight": 2.5}])
    assert isinstance(job.inputs["keyframes"], ImagesByFrame)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"weight": 0}, "weight"),
        ({"before": -1}, "before"),
        ({"paint": {"layers": [{"id": "a", "blend": "dissolve"}]}}, "blend"),
        ({"paint": {"layers": [{"id": "a", "parent": "no id"}]}}, "parent"),
    ],
)
def test_a_wrong_member_is_refused_with_its_place(change: dict[str, Any], place: str) -> None:
    with pytest.raises(BadProject) as refused:
        parsed({"frame": 12, "image": "key-12", **change})
    assert any(place in error.field for error in refused.value.errors)
