"""Opens the source that a task is about."""

from __future__ import annotations

from pipeline.methods.analogy.job_source import JobSource
from pipeline.methods.analogy.layer_source import LayerSource
from pipeline.methods.analogy.layers import Found, shot_of
from pipeline.methods.analogy.sources import Source
from pipeline.methods.base import Bench


def source_of(bench: Bench, layer: int, keyed: bool = False) -> Source:
    """The source of a layer (-1: the whole picture), with what the scan has found of it.

    Args:
        keyed: whether painted keys are the style.
    """
    shot = shot_of(bench)
    if shot is None:
        return JobSource(bench, keyed)
    chosen = shot.layer(layer)
    return LayerSource(bench, chosen, Found.of(bench.load("scan", chosen.artefact)), keyed)
