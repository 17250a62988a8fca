"""Every parameter of the analogy method, with unit, range and the paper's symbol."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.methods.base import Params
from pipeline.methods.fields import FlowName, Switch, choice, number


class AnalogyParams(Params):
    """Parameters of stylising animation by example (benard2013stylizing)."""

    # -- likeness
    guide_weight: float = number(
        4, 0, 50, "Likeness to the scene",
        "How much a place's look in the video must be like the style input's: higher keeps the subject, lower keeps "
        "the brush strokes.", "per squared gray level", "Likeness", "w_in",
    )  # fmt: skip
    colour_weight: float = number(
        0.25, 0, 4, "Likeness in colour", "Weight of the guides' hue beside their lightness.", "ratio", "Likeness"
    )
    texture_weight: float = number(
        1, 0, 50, "Likeness to the style",
        "How much each neighbourhood of the result must look like one of the style's.",
        "per squared gray level", "Likeness", "w_out",
    )  # fmt: skip
    coherence_weight: float = number(
        15, 0, 500, "Whole strokes", "How much neighbours should come from neighbouring places of the style.",
        "per px^2", "Likeness", "w_sc",
    )  # fmt: skip
    coherence_limit: float = number(
        16, 1, 400, "Reach of whole strokes", "Squared distance in the style beyond which it does not matter how far.",
        "px^2", "Likeness", "r_max",
    )  # fmt: skip
    variety_weight: float = number(
        0, 0, 5000, "Variety", "Penalty on using the same place of the style again and again; 0 = off.",
        "per use", "Likeness", "h_s",
    )  # fmt: skip
    variety_limit: float = number(
        2, 0, 100, "Uses that are free",
        "How often a place may be used without penalty, as a multiple of what is even.", "ratio", "Likeness", "h_tau",
    )  # fmt: skip
    colours: Literal["rgb", "lab"] = choice(
        "rgb", "Colour space", "What differences between the result's and the style's colours are measured in.",
        "Likeness",
    )  # fmt: skip
    rotation: Switch = choice(
        "off", "Turn strokes",
        "on = patches turn by the smallest angle that aligns the style's direction with the picture's.", "Likeness",
    )  # fmt: skip
    rotation_sigma: float = number(
        3, 0.5, 20, "Smoothness of directions", "Of the Gaussian that directions are averaged with.", "px", "Likeness"
    )

    # -- style
    tone_match: Literal["auto", "on", "off"] = choice(
        "auto", "Match tones",
        "Give the video's guide the lightness and hue of the style's. auto = unless a style input was given.", "Style",
    )  # fmt: skip
    style_smoothing: float = number(
        1, 0, 10, "Smoothing of the style input",
        "Where no style input is given: of the painting that takes its place.", "px", "Style",
    )  # fmt: skip
    guide_a_weight: float = number(4, 0, 50, "Weight of guide a", "Weight of the input guide_a.",
                                    "per squared gray level", "Style")  # fmt: skip
    guide_b_weight: float = number(4, 0, 50, "Weight of guide b", "Weight of the input guide_b.",
                                    "per squared gray level", "Style")  # fmt: skip
    guide_c_weight: float = number(4, 0, 50, "Weight of guide c", "Weight of the input guide_c.",
                                    "per squared gray level", "Style")  # fmt: skip

    # -- lines
    lines_weight: float = number(
        200, 0, 5000, "Lines",
        "How firmly lines of the input `lines` are drawn as those of `style_lines` are painted; 0 = off.",
        "per px^2", "Lines", "w_dt",
    )  # fmt: skip
    lines_reach: float = number(
        10, 1, 100, "Reach of lines", "Distance from a line beyond which it does not matter.", "px", "Lines", "d_max"
    )

    # -- time
    temporal: Switch = choice(
        "on", "Temporal coherence", "off = every frame on its own: the honest baseline, and it flickers.", "Time"
    )
    steadiness: float = number(
        1.5, 0, 100, "Steadiness", "How little a place's colour may change along the motion.",
        "per squared gray level", "Time", "w_tc",
    )  # fmt: skip
    flow: FlowName = choice("dis-medium", "Optical flow", "How motion is found where no velocities are given.", "Time")
    vectors: Literal["auto", "cycles", "eevee", "nuke"] = choice(
        "auto", "Sign of motion vectors",
        "How a renderer's vectors are stored. auto = all signs are tried on two frames, and the job says which fit.",
        "Time",
    )  # fmt: skip
    occlusion: Switch = choice(
        "on", "Occlusion", "off = nothing is taken to be hidden, and what appears drags trails (for comparison).",
        "Time",
    )  # fmt: skip
    occlusion_epsilon: float = number(
        2, 0.1, 100, "Occlusion tolerance", "Squared disagreement of both motions beyond which a place was hidden.",
        "px^2", "Time", "epsilon",
    )  # fmt: skip
    boil: float = number(
        0, 0, 1, "Boil",
        "Deliberate flicker: the share of the picture whose strokes are chosen afresh in each frame.", "ratio", "Time",
    )  # fmt: skip
    on_twos: Switch = choice(
        "off", "On twos", "on = each painting is shown for two frames; painted keyframes stay where they are.", "Time"
    )
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity", "How readily a hard cut is called, at which all begins afresh; 0 = never.",
        "ratio", "Time",
    )  # fmt: skip

    # -- keyframes
    key_guide_weight: float = number(
        2, 0, 50, "Likeness between keys", "`guide_weight` where painted keys are the style.",
        "per squared gray level", "Keyframes", "w_in",
    )  # fmt: skip
    key_colour_weight: float = number(
        2, 0, 4, "Likeness in colour between keys",
        "`colour_weight` where painted keys are the style: what was painted and what comes have the same hues.",
        "ratio", "Keyframes",
    )  # fmt: skip
    change_weight: float = number(
        0.2, 0, 50, "Change as the scene does", "Between keys: the style changes as the scene does.",
        "ratio to the likeness", "Keyframes", "w_din",
    )  # fmt: skip
    change_out_weight: float = number(
        0.1, 0, 50, "Change as the style does", "Between keys: the result changes as the style does from place to "
        "place.", "per squared gray level", "Keyframes", "w_dout",
    )  # fmt: skip

    key_iterations: int = Field(
        1, ge=1, le=20, title="Iterations between keys",
        description="`iterations` where painted keys are the style: they start near the result.",
        json_schema_extra={"unit": "rounds", "group": "Keyframes"},
    )  # fmt: skip

    key_search_radius: float = number(
        8, 1, 4096, "Search radius between keys", "`search_radius` where painted keys are the style.", "px", "Keyframes"
    )

    # -- search
    patch_radius: int = Field(
        4, ge=1, le=7, title="Patch radius", description="Neighbourhoods are 2 radius + 1 px wide.",
        json_schema_extra={"unit": "px", "group": "Search", "symbol": "Omega"},
    )  # fmt: skip
    patch_sigma: float = number(
        3, 0.5, 10, "Patch fall-off", "Of the Gaussian that a patch's pixels are weighted with.", "px", "Search",
        "sigma",
    )  # fmt: skip
    levels: int = Field(
        4, ge=1, le=7, title="Levels", description="Sizes, each half the next, from coarse to fine.",
        json_schema_extra={"unit": "levels", "group": "Search"},
    )  # fmt: skip
    iterations: int = Field(
        4, ge=1, le=20, title="Iterations", description="Rounds of PatchMatch a frame, level and sweep.",
        json_schema_extra={"unit": "rounds", "group": "Search"},
    )  # fmt: skip
    sweeps: int = Field(
        1, ge=1, le=4, title="Sweeps", description="Pairs of passes backward and forward through time a level.",
        json_schema_extra={"unit": "pairs", "group": "Search"},
    )  # fmt: skip
    search_radius: float = number(
        128, 1, 4096, "Search radius", "Of the random search at all but the coarsest level.", "px", "Search"
    )
