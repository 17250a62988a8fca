"""What the studio offers for layers of a method, as data: the web pages know no method by its name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Section = Literal["keys", "scribbles", "clusters", "regions"]
Tool = Literal["brush", "eraser", "smudge", "fill", "picker", "label", "region", "lasso", "direction"]


@dataclass(frozen=True)
class Studio:
    """Besides files, parameters and presets, which every method has.

    Attributes:
        sections: parts of the panel, and what belongs to them in the filmstrip: `keys` = frames that the artist paints,
            `scribbles` = marks of the foreground, `clusters` = found clusters and corrected label maps, `regions` =
            regions with styles and directions.
        tools: tools of the stage besides moving and magnifying the picture, in the order of the toolbar. `label` is
            shown once clusters are found, `region` while the service can find regions.
        painting: input that takes a painting of the style library; empty: none.
        painting_source: input that takes the picture which that painting shows; empty: none.
        cluster_artefacts: optional artefacts that a film needs so that the studio can show its clusters.
    """

    sections: tuple[Section, ...] = ()
    tools: tuple[Tool, ...] = ()
    painting: str = ""
    painting_source: str = ""
    cluster_artefacts: tuple[str, ...] = ()
