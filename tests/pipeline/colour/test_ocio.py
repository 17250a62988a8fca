"""OpenColorIO: a studio's own configuration by OCIO, and transforms that are inverses of one another."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import PyOpenColorIO as OCIO  # noqa: N814
import pytest

from pipeline.colour import ocio
from pipeline.errors import BadParameter


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    """No configuration is kept from test to test."""
    yield
    for cached in (ocio.config, ocio._between):
        cached.cache_clear()


def colours(least: float, most: float) -> np.ndarray:
    return np.random.default_rng(4).uniform(least, most, (8, 8, 3)).astype(np.float32)


def test_linear_light_is_the_inverse_of_encoding_also_below_0_and_above_1() -> None:
    light = colours(-2, 6)
    np.testing.assert_allclose(ocio.linear(ocio.encoded(light)), light, rtol=1e-5, atol=1e-6)
    assert ocio.encoded(np.full((1, 1, 3), 0.18, np.float32))[0, 0, 0] == pytest.approx(0.4614, abs=1e-4)


def test_a_studio_has_names_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = OCIO.Config.CreateFromFile(ocio.BUILT_IN)
    to_reference = OCIO.BuiltinTransform(style="ACEScg_to_ACES2065-1")
    plate = OCIO.ColorSpace(name="Show 7 plates", toReference=to_reference, encoding="scene-linear")
    own.addColorSpace(plate)
    (tmp_path / "config.ocio").write_text(own.serialize())
    monkeypatch.setenv("OCIO", str(tmp_path / "config.ocio"))
    ocio.config.cache_clear()
    ocio._between.cache_clear()
    shown = ocio.to_display(np.full((1, 1, 3), (0.8, 0.1, 0.05), np.float32), "Show 7 plates")[0, 0] * 255
    np.testing.assert_allclose(shown, (285.9, 24.4, 44.3), atol=0.2)
    monkeypatch.delenv("OCIO")
    ocio.config.cache_clear()
    with pytest.raises(BadParameter):
        ocio.check_space("Show 7 plates", "source.colour")


def test_a_configuration_that_cannot_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in (("missing.ocio", None), ("bad.ocio", "ocio_profile_version: 99\n")):
        if text:
            (tmp_path / name).write_text(text)
        monkeypatch.setenv("OCIO", str(tmp_path / name))
        ocio.config.cache_clear()
        with pytest.raises(BadParameter) as caught:
            ocio.check_space("ACEScg", "source.colour")
        assert caught.value.field == "OCIO" and caught.value.remedy
