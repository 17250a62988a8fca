"""Jobs of a project document: inputs, frame numbers; the same document gives the same bytes."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from pipeline.errors import BadParameter
from tests.workers.projects.documents import DESIGNED, asset_id, document, layer
from workers.projects.checking import problems
from workers.projects.faults import BadProject
from workers.projects.materials import ImagesByFrame, JsonValue, Uploaded, write_material
from workers.projects.parsing import parse_document
from workers.projects.submissions import Selection, submissions


def test_every_project_part_reaches_its_method_input() -> None:
    keyed = layer(
        "analogy", keys=[{"frame": 12, "image": "key-12", "mask": "mask-12"}], inputs={"style_output": "wave"}
    )
    drawn = [{"frame": 3, "image": "fg-0"}]
    patches = layer("patches", scribbles=drawn, labels=drawn, label_styles={"background": "wash"})
    abstract = layer("abstraction", importance=drawn, histogram={"hue": [1] * 36}, inputs={"reference": "wave"})
    found = [submissions(parse_document(document(one)))[0].inputs for one in (keyed, patches, abstract)]
    video = {"video": Uploaded(asset_id("a"))}
    image = ImagesByFrame(((3, asset_id("f")),))
    assert found == [
        video | {"style_output": Uploaded(asset_id("b")), "keyframes": ImagesByFrame(((12, asset_id("c")),)),
                 "masks": ImagesByFrame(((12, asset_id("d")),))},
        video | {"masks": image, "labels": image, "styles": JsonValue('{"background":"wash"}')},
        video | {"reference": Uploaded(asset_id("b")), "histogram": JsonValue.of({"hue": [1] * 36}),
                 "importance": image},
    ]  # fmt: skip


def test_a_design_is_assembled_from_the_layer() -> None:
    (job,) = submissions(parse_document(document(DESIGNED)))
    assert job.method == "multistyle" and job.params == {"style": "pointillism"}
    design = job.inputs["design"]
    assert isinstance(design, JsonValue)
    written = json.loads(design.text)
    assert written["version"] == 1 and written["keys"] == DESIGNED["parts"]["design"]["keys"]
    assert job.inputs["masks"] == ImagesByFrame(((0, asset_id("e")),))


def test_one_layer_alone_is_a_job_of_that_layer_with_its_opacity() -> None:
    value = document(layer("abstraction"), output={"format": "exr", "layer": "l1", "colour": "ACEScg"})
    (shot,) = value["shots"]
    shot["layers"] = [
        shot["layers"][0] | {"id": "l0"},
        shot["layers"][0] | {"id": "l1", "opacity": 0.4, "visible": False},
    ]
    (job,) = submissions(parse_document(value))
    assert job.method == "layers" and job.params["alone"] and [row["opacity"] for row in job.params["layers"]] == [0.4]
    assert (job.output.alpha, job.output.colour, job.output.format) == ("painted", "ACEScg", "exr")
    shot["layers"].pop()
    (fault,) = [each for each in problems(parse_document(value), {}) if each.path == "/output/layer"]
    assert "l0" in fault.remedy


def test_passes_are_those_of_the_layers_that_make_them() -> None:
    value = document(layer("abstraction"), output={"passes": ["flow", "lines"], "passes_format": "png"})
    (job,) = submissions(parse_document(value))
    assert (job.output.passes, job.output.passes_format) == (("flow", "lines"), "png")
    (shot,) = value["shots"]
    shot["layers"].append({"id": "l2", "method": "multistyle", "opacity": 0.5})
    (job,) = submissions(parse_document(value))
    assert job.method == "layers" and job.output.passes == ("layer0.flow", "layer0.lines", "layer1.flow")
    assert not [each for each in problems(parse_document(value), {}) if each.path.startswith("/output/passes")]
    value["output"] = {"passes": ["flows"], "passes_format": "tif"}
    faults = {each.path: each.remedy for each in problems(parse_document(value), {})}
    assert "stroke-ids" in faults["/output/passes"] and "png" in faults["/output/passes_format"]


def test_unsupported_parts_are_not_submitted() -> None:
    (job,) = submissions(parse_document(document(DESIGNED | {"method": "abstraction", "params": {}})))
    assert set(job.inputs) == {"video"}


def test_keys_outside_the_range_of_a_shot_count() -> None:
    parsed = parse_document(document(layer("analogy", keys=[{"frame": 12, "image": "key-12"}])))
    (job,) = submissions(parsed, Selection(frames=(13, 20)))
    assert job.frames == (13, 20) and job.inputs["keyframes"] == ImagesByFrame(((12, asset_id("c")),))


def test_a_variant_becomes_a_job_with_changed_parameters() -> None:
    value = document(DESIGNED, variants=[
        {"id": "v1", "shot": "s1", "layer": "l1", "set": {"params": {"style": None, "relief": 3}, "seed": 7}},
        {"id": "v2", "shot": "s1", "layer": "l1", "set": {"seed": "no"}},
    ])  # fmt: skip
    parsed = parse_document(value)
    (job,) = submissions(parsed, Selection(variants=["v1"]))
    assert (job.variant, job.params, job.seed) == ("v1", {"relief": 3}, 7)
    with pytest.raises(BadProject) as caught:
        submissions(parsed, Selection(variants=["v2"]))
    assert caught.value.errors[0].path == "/variants/1/set/seed"
    with pytest.raises(BadParameter, match="v1, v2"):
        submissions(parsed, Selection(variants=["v3"]))


def test_submission_files_are_deterministic(tmp_path: Path) -> None:
    images = {asset_id("c"): b"\x89PNG\r\n\x1a\n one", asset_id("d"): b"\xff\xd8\xff two"}
    made = ImagesByFrame(((2, asset_id("c")), (11, asset_id("d"))))
    written = []
    for name in "ab":
        assert write_material(made, tmp_path / name, images.__getitem__) == "frames.zip"
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]
    with zipfile.ZipFile(tmp_path / "a") as archive:
        assert archive.namelist() == ["0000002.png", "0000011.jpg"]
    assert JsonValue.of({"b": 1, "a": "é"}).text == '{"a":"é","b":1}'
