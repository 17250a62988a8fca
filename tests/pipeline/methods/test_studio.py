"""What methods say about the studio names only what they have."""

from __future__ import annotations

import pytest

from pipeline.methods import BUILT_IN, method


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_studio_of_a_method_names_its_own_inputs_and_artefacts(name: str) -> None:
    found = method(name)
    inputs = {spec.name: spec for spec in found.inputs}
    assert {found.studio.painting, found.studio.painting_source} <= {"", *inputs}
    assert set(found.studio.cluster_artefacts) <= set(found.artefacts)
    parts = {spec.part.partition(".")[0] for spec in inputs.values()} - {""}
    assert set(found.studio.sections) - {"clusters", "regions"} <= parts
    assert len(set(found.studio.tools)) == len(found.studio.tools)
