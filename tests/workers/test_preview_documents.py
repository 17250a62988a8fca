"""A document that a preview is given for an input that the method does not have is refused, not ignored."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import BadParameter
from tests.workers.conftest import request_on
from workers.farm import Farm


def test_a_document_for_an_unknown_input_is_refused(farm: Farm, data: Path) -> None:
    with pytest.raises(BadParameter) as caught:
        farm.jobs.preview(request_on(farm, data), "", 0, documents={"plan": {"version": 1}})
    assert caught.value.field == "documents.plan"
