"""Description of the sections, tools and overlays of the studio for a method, as data: web pages name no method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Editor = Literal["keys", "marks", "clusters", "regions", "histogram"]
Tool = Literal["brush", "eraser", "smudge", "fill", "picker", "object", "label", "region", "lasso", "correct",
    "direction",
]  # fmt: skip
PreviewKind = Literal[
    "paint", "source", "styles", "cuts", "flicker", "keys", "propagate", "regions", "directions", "clusters", "spread",
    "object", "matte",
]  # fmt: skip
"""Last part of the path of a request for previews."""


@dataclass(frozen=True)
class Mark:
    """A colour of marks. `colour`: "#rrggbb"; `title`: what is marked with it, after "the"."""

    title: str
    colour: str


@dataclass(frozen=True)
class Choice:
    """A value, and what the studio calls it.

    Attributes:
        values: of a style: its number for each slider, by the slider's name.
        technique: of a style: its other numbers, which have no slider and change between keys as those do.
    """

    value: str
    title: str
    values: Mapping[str, float] = field(default_factory=dict)
    technique: Mapping[str, float] = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash((self.value, self.title))


@dataclass(frozen=True)
class Slider:
    """A parameter of a region's style: its name in the document, and the range that the studio offers.

    Attributes:
        about: a sentence on what it does, with its unit.
        basic: whether it is shown at first; the others are in a group that opens.
        circular: whether it is an angle in degrees, which changes the shorter way round.
        param: the method's parameter that changes it in all regions whose key names no style; empty: none.
        by: how that parameter changes it: as a factor, or as a sum.
    """

    name: str
    title: str
    minimum: float
    maximum: float
    step: float
    about: str = ""
    basic: bool = True
    circular: bool = False
    param: str = ""
    by: Literal["factor", "sum"] = "sum"


@dataclass(frozen=True)
class Overlay:
    """A picture that the studio can draw over the stage.

    Attributes:
        kind: `mask` = a veil over what is black in it, `marks` = marks where the film has them (`Method.move_marks`),
            `labels` = a colour for each label of a label map, and a lane of the labels' uncertainty below the
            filmstrip.
        title: of the switch that shows it.
        preview: kind of the preview that computes it.
        after: parts of the layer on which it depends, so that a change of them makes it old.
        artefact: optional artefact with the label maps of a finished film, `<frame of six digits>.png`; empty: none.
        uncertainty: optional artefact with the uncertainty of its labels, JSON: frame -> label -> 0..1; empty: none.
    """

    kind: Literal["mask", "marks", "labels"]
    title: str
    preview: PreviewKind
    after: tuple[str, ...] = ()
    artefact: str = ""
    uncertainty: str = ""


@dataclass(frozen=True)
class Section:
    """A section of the panel: an editor of one part of the layer, with what belongs to it in the filmstrip.

    Attributes:
        editor: `keys` = frames that the artist paints (`PaintedKeys`), `marks` = marks on frames (`Drawings`),
            `clusters` = found clusters and their corrected label maps (`Drawings` that may have `solve`, the frames
            that one changes), `regions` = a document with regions, styles, keys and directions (docs/multistyle.md),
            `histogram` = a colour scheme (docs/abstraction.md, "Inputs"), on the live page, too.
        part: name of the part in `Method.parts`.
        title, hint: heading, and a sentence of help below it. `regions` has its own.
        marks: colours of the editor `marks`.
        overlay: drawn over the stage while the section is shown.
        sliders: parameters of styles in the editor `regions`.
        styles: those that a region can have; `style_param` is the method's parameter with the same values.
        replaces: the method's parameters that a ready-made document (`Method.input_examples`) makes needless.
    """

    editor: Editor
    part: str
    title: str
    hint: str = ""
    marks: tuple[Mark, ...] = ()
    overlay: Overlay | None = None
    sliders: tuple[Slider, ...] = ()
    styles: tuple[Choice, ...] = ()
    style_param: str = ""
    replaces: tuple[str, ...] = ()


@dataclass(frozen=True)
class Studio:
    """Besides files, parameters and presets, which every method has.

    Attributes:
        sections: in the order of the panel.
        tools: tools of the stage besides moving and magnifying the picture, in the order of the toolbar. `object` fills
            what is clicked, or in a box; it is shown while the service makes previews, `label` once clusters are found,
            `region` while the service can find regions.
        painting: input that takes a painting of the style library; empty: none.
        painting_source: input that takes the picture which that painting shows; empty: none.
        cuts: parameter that sets how readily cuts are found, at most 1 by default; empty: cuts are found alike always.
    """

    sections: tuple[Section, ...] = ()
    tools: tuple[Tool, ...] = ()
    painting: str = ""
    painting_source: str = ""
    cuts: str = ""
