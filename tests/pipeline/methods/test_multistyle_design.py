"""The design document: errors with their path, and interpolation between keys."""

from __future__ import annotations

import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.methods import method
from pipeline.methods.local import LocalContext, run_plan
from pipeline.methods.multistyle.design import Design, eased, keys_around, parse, schema
from pipeline.methods.multistyle.effects import EFFECTS, document
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.styles import STYLES


def good() -> dict[str, Any]:
    """A design that uses every feature."""
    square = [[0.1, 0.1], [0.6, 0.1], [0.6, 0.7]]
    return {
        "version": 1,
        "regions": {
            "swan": {"label": 1, "border": "sharp"},
            "beak": {"polygons": [{"frame": 0, "points": square}, {"frame": 9, "points": square}], "of": "swan"},
            "trees": {"tubes": [3, 4]},
            "water": {"objects": [1]},
            "rest": {"border": "soft"},
        },
        "styles": {"mine": {"base": "pointillism", "size": 9.5}},
        "keys": [
            {"region": "swan", "frame": 0, "style": "mine", "set": {"hue": 20}, "ease": "smooth"},
            {"region": "swan", "frame": 8, "style": "van-gogh"},
            {"region": "rest"},
        ],
        "directions": [
            {
                "region": "water",
                "frame": 2,
                "edge_weight": 0.2,
                "elements": [
                    {"pattern": "center", "at": [0.5, 0.5]},
                    {"pattern": "trisector", "at": [0.2, 1.5], "angle": 30, "reach": 0.4, "strength": 2},
                    {"pattern": "regular", "at": [0, 0], "reach": "everywhere"},
                ],
                "follow": False,
            },
            {"region": "trees", "free": True},
        ],
    }


def changed(path: str, value: Any) -> dict[str, Any]:
    """The valid design with one value changed at a path such as "keys.0.frame"."""
    made = good()
    *way, leaf = path.split(".")
    at: Any = made
    for part in way:
        at = at[int(part)] if isinstance(at, list) else at[part]
    if isinstance(at, list):
        at[int(leaf)] = value
    else:
        at[leaf] = value
    return made


def test_a_design_with_all_features_is_valid_and_matches_the_schema() -> None:
    design = parse(good(), frames=10, masks=True)
    assert design.names == ("rest", "swan", "beak", "trees", "water")
    jsonschema.Draft202012Validator.check_schema(schema())
    jsonschema.validate(good(), schema())


BAD = {
    "another version": ("version", 2, "version"),
    "no number": ("keys.0.set.hue", math.nan, "keys[0].set.hue"),
    "infinity": ("styles.mine.size", math.inf, "styles.mine.size"),
    "a weight that is none": ("directions.0.edge_weight", math.nan, "directions[0].edge_weight"),
    "a weight out of range": ("directions.0.edge_weight", 1.5, "directions[0].edge_weight"),
    "an unknown region": ("keys.1.region", "goose", "keys[1].region"),
    "an unknown region of directions": ("directions.0.region", "goose", "directions[0].region"),
    "an unknown style": ("keys.0.style", "cubism", "keys[0].style"),
    "a keyframe after the end": ("keys.1.frame", 10, "keys[1].frame"),
    "a keyframe before the start": ("keys.1.frame", -1, "keys[1].frame"),
    "a direction after the end": ("directions.0.frame", 99, "directions[0].frame"),
    "an outline after the end": ("regions.beak.polygons.1.frame", 10, "regions.beak.polygons[1].frame"),
    "two keys at one frame": ("keys.1.frame", 0, "keys[1].frame"),
    "two directions at one frame": ("directions.1", {"region": "water", "frame": 2}, "directions[1].frame"),
    "an outline of two points": ("regions.beak.polygons.0.points", [[0, 0], [1, 1]], "regions.beak.polygons[0].points"),
    "a region of nothing": ("regions.trees", {}, "regions.trees"),
    "one label for two": ("regions.trees", {"label": 1}, "regions.trees.label"),
    "one tube for two": ("regions.water", {"tubes": [4]}, "regions.water.tubes"),
    "a part of what is not there": ("regions.beak.of", "goose", "regions.beak.of"),
    "a part of itself": ("regions.swan.of", "beak", "regions.swan.of"),
    "a rest of tubes": ("regions.rest", {"tubes": [9]}, "regions.rest"),
    "a reach that is no length": ("directions.0.elements.0.reach", "far", "directions[0].elements[0].reach"),
    "an unknown pattern": ("directions.0.elements.0.pattern", "swirl", "directions[0].elements[0].pattern"),
    "an unknown key": ("keys.0.sytle", "mine", "keys[0].sytle"),
    "an unknown ease": ("keys.0.ease", "bouncy", "keys[0].ease"),
    "a name that is none": ("regions.", {"label": 7}, "regions."),
    "no list": ("keys", {"region": "rest"}, "keys"),
}  # fmt: skip


@pytest.mark.parametrize(("path", "value", "field"), BAD.values(), ids=BAD.keys())
def test_a_fault_is_rejected_with_its_path(path: str, value: Any, field: str) -> None:
    with pytest.raises(BadParameter) as caught:
        parse(changed(path, value), frames=10, masks=True)
    assert caught.value.field.startswith(f"inputs.design.{field}")
    assert caught.value.message and caught.value.remedy


def test_nan_is_rejected() -> None:
    text = json.dumps(good()).replace('"hue": 20', '"hue": NaN')
    with pytest.raises(BadParameter) as caught:
        parse(json.loads(text))
    assert caught.value.field == "inputs.design.keys[0].set.hue"


@pytest.mark.parametrize("document", [None, [], "design", 7, {}])
def test_a_document_that_is_not_a_design_is_rejected(document: Any) -> None:
    with pytest.raises(BadParameter) as caught:
        parse(document)
    assert caught.value.field.startswith("inputs.design")


def test_a_label_needs_label_maps() -> None:
    with pytest.raises(BadParameter) as caught:
        parse(good(), masks=False)
    assert caught.value.field == "inputs.design.regions.swan.label"


def test_own_styles_and_changes_build_on_each_other() -> None:
    design, base = parse(good()), STYLES["watercolor"].style
    first, second, rest = (design.style(key, base) for key in design.keys)
    assert (first.size, first.hue, first.length) == (9.5, 20, 0)
    assert second == STYLES["van-gogh"].style and rest == base


def test_styles_are_interpolated_between_keys_and_constant_outside() -> None:
    design = parse(good())
    before, after, t = keys_around(design.keys, "swan", 2) or (None, None, 0)
    assert (before, after) == (design.keys[0], design.keys[1]) and t == eased(0.25, "smooth") == 0.15625
    assert keys_around(design.keys, "swan", 8) == (design.keys[1], design.keys[1], 0.0)
    assert keys_around(design.keys, "swan", 500) == (design.keys[1], design.keys[1], 0.0)
    assert keys_around(design.keys, "water", 3) is None


@pytest.mark.parametrize("ease", ["linear", "smooth", "in", "out", "hold"])
def test_every_ease_is_monotonic_from_0_to_1(ease: Any) -> None:
    way = [eased(k / 50, ease) for k in range(51)]
    assert way[0] == 0 and way[-1] == 1 and way == sorted(way)
    assert ease == "linear" or way != [k / 50 for k in range(51)]


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("frames", [1, 2, 3, 90])
def test_effects_are_valid_designs_for_any_length(effect: Any, frames: int) -> None:
    assert isinstance(parse(document(effect, frames), frames=frames), Design)


def test_a_style_does_not_spread_across_a_sharp_border_into_regions_without_keys() -> None:
    """Everything else keeps the job's own style when only one region, with a sharp border, has a key."""
    square = [[0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 1.0]]
    region = {"polygons": [{"frame": 0, "points": square}], "border": "sharp"}
    keys = [{"region": "box", "frame": 0, "set": {"hue": 90}}]
    frames = [np.full((64, 96, 3), (90, 140, 70), np.uint8)] * 2
    painted = []
    for given in ({}, {"design": {"version": 1, "regions": {"box": region}, "keys": keys}}):
        context = LocalContext(MultistyleParams(), frames, given)
        run_plan(method("multistyle"), context)
        painted.append(context.emitted[1].astype(int))
    change = np.abs(painted[0] - painted[1]).mean(axis=(0, 2))
    assert change[:30].mean() < 2 and change[60:].mean() > 20
