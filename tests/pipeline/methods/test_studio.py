"""What methods say about the studio names only what they have."""

from __future__ import annotations

import pytest

from pipeline.errors import BadInput
from pipeline.method_names import BUILT_IN
from pipeline.methods import layer_parts, method
from pipeline.methods.base import InputSpec, LayerPart, Method
from pipeline.methods.parts import Drawings


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_studio_of_a_method_names_its_own_inputs_and_artefacts(name: str) -> None:
    found = method(name)
    inputs = {spec.name: spec for spec in found.inputs}
    assert {found.studio.painting, found.studio.painting_source} <= {"", *inputs}
    assert found.studio.cuts in {"", *found.Params.model_fields}
    assert len(set(found.studio.tools)) == len(found.studio.tools)
    for section in found.studio.sections:
        assert section.part in {part.name for part in found.parts}
        assert {*section.replaces, section.style_param} <= {"", *found.Params.model_fields}
        if section.overlay is not None:
            assert section.overlay.preview in found.preview_kinds()
            assert {section.overlay.artefact, section.overlay.uncertainty} <= {"", *found.artefacts}
            assert set(section.overlay.after) <= {part.name for part in found.parts}


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_part_is_made_into_an_input(name: str) -> None:
    used = {spec.part.partition(".")[0] for spec in method(name).inputs} - {""}
    assert used == {part.name for part in method(name).parts}


class _Other(Method):
    name = "other"
    inputs = (InputSpec("marks", "images", False, "Marks", "Marks.", "keys.image"),)


def test_a_part_that_is_described_otherwise_by_another_method_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Other, "parts", (LayerPart("keys", "Keys", Drawings),), raising=False)
    monkeypatch.setattr("pipeline.methods.methods", lambda: {"analogy": method("analogy"), "other": _Other()})
    with pytest.raises(BadInput, match="describes a part otherwise"):
        layer_parts()


def test_an_input_of_a_part_that_its_method_does_not_describe_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.methods.methods", lambda: {"analogy": method("analogy"), "other": _Other()})
    with pytest.raises(BadInput, match="names a part"):
        layer_parts()
