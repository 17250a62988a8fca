"""Parameters of the analogy method, with unit, range and the paper's symbol."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field

from pipeline.methods.base import Alternatives, Params, When
from pipeline.methods.fields import FlowName, Switch, choice, number, varying

_KEYED = (When(inputs=("keyframes",)),)
_COHERENT = When(params={"temporal": ("on",)})
_BETWEEN_KEYS = (When(inputs=("keyframes",), params={"temporal": ("on",)}),)
_GUIDES = ("a", "b", "c")


def overridden(params: AnalogyParams, values: Mapping[str, Any]) -> AnalogyParams:
    """The parameters with other values for some, as a layer of a shot has them. Raises ValidationError."""
    return AnalogyParams.model_validate({**params.model_dump(), **values}) if values else params


class AnalogyParams(Params):
    """Parameters of stylising animation by example (benard2013stylizing)."""

    applies_when: ClassVar[Mapping[str, Alternatives]] = {
        **dict.fromkeys(("key_guide_weight", "key_colour_weight", "key_transparency"), _KEYED),
        **dict.fromkeys(("change_weight", "change_out_weight"), _BETWEEN_KEYS),
        **dict.fromkeys(("key_blend", "key_iterations", "key_search_radius"), _BETWEEN_KEYS),
        **{f"guide_{name}_weight": (When(inputs=(f"guide_{name}",)),) for name in _GUIDES},
        **dict.fromkeys(("lines_weight", "lines_reach"), (When(inputs=("lines",)),)),
        **dict.fromkeys(("steadiness", "sweeps", "sweep_order", "refinement"), (_COHERENT,)),
        "flow": (When(params={"temporal": ("on",)}, without_passes=("motion",)),),
        "rotation_sigma": (
            When(params={"rotation": ("on",)}),
            When(params={"rotation": ("auto",)}, inputs=("directions", "style_directions")),
        ),
        "style_smoothing": (When(inputs=("style_output",), without=("style",)),),
        "variety_limit": (When(above={"variety_weight": 0}),),
        "stroke_scale": (When(inputs=("style_output",), without=("style", "style_lines", "style_directions")),),
    }

    # -- likeness
    guide_weight: float = varying(
        4, 0, 50, "Likeness to the scene",
        "Weight of the difference between the video and the style input at the chosen position. Larger values show the "
        "subject more clearly, smaller values keep brush strokes whole.", "per squared gray level", "Likeness", "w_in",
    )  # fmt: skip
    colour_weight: float = number(
        1, 0, 4, "Likeness in colour",
        "Weight of hue differences relative to lightness differences. Larger values bind the colours of the style to "
        "the hues of the scene. With matched tones, hues of a nearly gray video count less.", "ratio", "Likeness",
    )  # fmt: skip
    texture_weight: float = varying(
        1, 0, 50, "Likeness to the style",
        "Weight of the difference between a neighbourhood of the result and one of the style. Larger values reproduce "
        "the texture of the style more faithfully.",
        "per squared gray level", "Likeness", "w_out",
    )  # fmt: skip
    coherence_weight: float = varying(
        15, 0, 500, "Spatial coherence",
        "Penalty if neighbouring pixels do not come from neighbouring positions of the style. Larger values keep "
        "larger pieces of the style whole.", "per px^2", "Likeness", "w_sc",
    )  # fmt: skip
    coherence_limit: float = number(
        16, 1, 400, "Limit of spatial coherence",
        "Squared distance in the style above which that penalty no longer grows. Larger values make breaks between "
        "pieces of the style rarer.", "px^2", "Likeness", "r_max",
    )  # fmt: skip
    variety_weight: float = number(
        10, 0, 5000, "Variety",
        "Penalty on the repeated use of one position of the style; 0 = off. Larger values use more of the painting and "
        "repeat less.", "per use", "Likeness", "h_s",
    )  # fmt: skip
    variety_limit: float = number(
        4, 0, 100, "Free uses",
        "Number of uses of a position without penalty, as a multiple of the mean. Larger values permit more "
        "repetition.", "ratio", "Likeness", "h_tau",
    )  # fmt: skip
    colours: Literal["rgb", "lab"] = choice(
        "rgb", "Colour space", "Colour space in which the result is compared with the style.", "Likeness"
    )
    rotation: Literal["auto", "on", "off"] = choice(
        "auto", "Rotate strokes",
        "on = neighbourhoods are rotated by the smallest angle that aligns the direction of the style with that of the "
        "picture, so that strokes follow shapes; takes a third longer. auto = on if directions are given.",
        "Likeness",
    )  # fmt: skip
    rotation_sigma: float = number(
        3, 0.5, 20, "Smoothness of directions",
        "Standard deviation of the Gaussian that averages computed directions. Larger values give calmer directions "
        "with less detail.", "px", "Likeness",
    )  # fmt: skip

    # -- style
    tone_match: Literal["auto", "on", "off"] = choice(
        "auto", "Match tones",
        "on = the lightness and hue of the video are mapped to the distribution of the style, so that all tones of the "
        "painting are used. auto = on unless a style input is given.", "Style",
    )  # fmt: skip
    tone_limit: float = number(
        2, 1, 20, "Limit of contrast",
        "Factor by which matching tones may raise or lower the contrast of the video, and its root that by which they "
        "make the video brighter or darker: a night stays dark, as far as the painting has dark tones. Larger values "
        "use more tones of the painting and turn small differences of lightness into blotches. Contrast is raised less "
        "where figures would merge with their surroundings; details keep their contrast.", "ratio", "Style",
    )  # fmt: skip
    stroke_scale: float = number(
        1, 0, 8, "Size of strokes",
        "Size of the strokes of a painting that is given alone. 1 = a stroke takes the same share of the frame as of "
        "the painting, at every frame size; 2 = twice as large; 0 = the pixels of the painting are copied as they are.",
        "ratio", "Style",
    )  # fmt: skip
    style_smoothing: float = number(
        1, 0, 10, "Smoothing of the style input",
        "Smoothing with which the style input is derived from the painting if none is given. Larger values remove "
        "broader strokes. Unit: for a painting given alone, px of a frame of 480x270; otherwise px of the painting.",
        "px", "Style",
    )  # fmt: skip
    guide_a_weight: float = number(
        4, 0, 50, "Weight of guide a", "Weight of differences in the input guide_a. Larger values follow it more "
        "closely.", "per squared gray level", "Style",
    )  # fmt: skip
    guide_b_weight: float = number(
        4, 0, 50, "Weight of guide b", "Weight of differences in the input guide_b. Larger values follow it more "
        "closely.", "per squared gray level", "Style",
    )  # fmt: skip
    guide_c_weight: float = number(
        4, 0, 50, "Weight of guide c", "Weight of differences in the input guide_c. Larger values follow it more "
        "closely.", "per squared gray level", "Style",
    )  # fmt: skip
    edge_guide: float = number(
        0, 0, 50, "Guide of edges",
        "Weight of a guide that is computed from the video and from the scene of the painting: how strong the edges of "
        "the lightness are. Larger values put contours of the painting on contours of the video.",
        "per squared gray level", "Style",
    )  # fmt: skip
    place_guide: float = number(
        0, 0, 50, "Guide of places",
        "Weight of a computed guide: where in the picture a pixel is, in its width and height. Larger values take "
        "paint from the same place of the painting, which suits a painting, or keys, of the same composition.",
        "per squared gray level", "Style",
    )  # fmt: skip
    face_guide: float = number(
        0, 0, 50, "Guide of faces",
        "Weight of a computed guide: the heads of frontal faces. Larger values paint faces with paint of faces, if "
        "some are found in the painting or in the scene that it shows.", "per squared gray level", "Style",
    )  # fmt: skip
    guided_stills: Literal["auto", "off"] = choice(
        "auto", "Still images with guides",
        "auto = for an image whose style has a registered scene or guides, the method chooses the other weights, and "
        "guide weights are those of EbSynth: the weight of the texture is doubled; coherence and variety are raised, "
        "less so where the guides change faster in the image than in the style; two more levels; half more "
        "iterations at all but the finest level, where overlapping patches are averaged, and a quarter fewer at that. "
        "The set values are scaled. off = they are used as they are.", "Style",
    )  # fmt: skip

    # -- lines
    lines_weight: float = number(
        200, 0, 5000, "Lines",
        "Weight of the difference between the distances to the nearest line in the video and in the style; 0 = off. "
        "Larger values draw the lines of the video more firmly with the lines of the style.",
        "per px^2", "Lines", "w_dt",
    )  # fmt: skip
    lines_reach: float = number(
        10, 1, 100, "Reach of lines",
        "Limit of that difference. Larger values influence a wider band along the lines.", "px", "Lines", "d_max",
    )  # fmt: skip

    # -- time
    temporal: Switch = choice(
        "on", "Temporal coherence",
        "on = paint moves with the scene; off = every frame is synthesised independently and flickers, for comparison.",
        "Time",
    )  # fmt: skip
    steadiness: float = varying(
        1.5, 0, 100, "Steadiness",
        "Penalty on changes of colour along the motion. Larger values flicker less and adapt less to changes of the "
        "scene.",
        "per squared gray level", "Time", "w_tc",
    )  # fmt: skip
    coarse_steadiness: float = number(
        0.25, 0, 1, "Steadiness of coarse levels",
        "Factor of the steadiness at each coarser level. Coarse levels determine which part of the style goes where: "
        "smaller values let them follow the scene; 1 = one weight at all levels, as in the paper.", "ratio", "Time",
    )  # fmt: skip
    flow: FlowName = choice(
        "dis-medium", "Optical flow", "Method that estimates motion if no velocities are given.", "Time"
    )
    vectors: Literal["auto", "cycles", "eevee", "nuke"] = choice(
        "auto", "Sign of motion vectors",
        "Convention in which the renderer stores motion vectors. auto = all signs are tried on two frames, and the "
        "result of the scan states the best one.",
        "Time",
    )  # fmt: skip
    occlusion: Switch = choice(
        "on", "Occlusion",
        "on = temporal coherence ignores pixels that are hidden in the neighbouring frame; off = moving objects leave "
        "trails, for comparison.",
        "Time",
    )  # fmt: skip
    occlusion_epsilon: float = number(
        2, 0.1, 100, "Occlusion tolerance",
        "Squared difference of forward and backward motion above which a pixel counts as hidden. Larger values detect "
        "less occlusion.",
        "px^2", "Time", "epsilon",
    )  # fmt: skip
    boil: float = varying(
        0, 0, 1, "Boil",
        "Deliberate flicker: the fraction of the picture that is chosen anew in each frame. Larger values look more "
        "like drawn animation; 0 = off.", "ratio", "Time",
    )  # fmt: skip
    on_twos: Switch = choice(
        "off", "On twos", "on = each painting is shown for two frames; painted keyframes keep their frames.", "Time"
    )
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity",
        "Sensitivity of the detection of hard cuts, at which synthesis starts anew. Larger values detect more cuts; "
        "0 = no cuts.",
        "ratio", "Time",
    )  # fmt: skip

    # -- keyframes
    key_guide_weight: float = varying(
        2, 0, 50, "Likeness between keys", "Replaces `guide_weight` where painted keyframes are the style.",
        "per squared gray level", "Keyframes", "w_in",
    )  # fmt: skip
    key_colour_weight: float = number(
        2, 0, 4, "Likeness in colour between keys",
        "Replaces `colour_weight` where painted keyframes are the style. It is larger, because keyframes and frames "
        "have the same hues.",
        "ratio", "Keyframes",
    )  # fmt: skip
    change_weight: float = number(
        0.2, 0, 50, "Change with the scene",
        "Weight with which the positions in the style change as the scene changes, relative to the likeness. Larger "
        "values follow changes of light between keyframes more closely.",
        "ratio to the likeness", "Keyframes", "w_din",
    )  # fmt: skip
    change_out_weight: float = number(
        0.1, 0, 50, "Change with the style",
        "Weight with which the result changes as the style changes between positions. Its effect is small, as the "
        "paper notes.", "per squared gray level", "Keyframes", "w_dout",
    )  # fmt: skip
    key_transparency: Literal["half", "glaze"] = choice(
        "half", "Transparency of keys",
        "Meaning of semi-transparent paint of a key: half = opaque from half opacity on, else not painted; glaze = it "
        "is seen over the frame that it was painted over, as in the paint program, from a tenth on. In a layer with a "
        "silhouette it is the layer's opacity.", "Keyframes",
    )  # fmt: skip
    key_blend: float = varying(
        1, 0, 1, "Blend of keys",
        "Share to which the colours of frames between two keyframes are adjusted to a blend of both, while their "
        "texture stays. Colours are blended where both keyframes show what the frame shows. 0 = every pixel has a "
        "colour of a keyframe; patches of one stand in the other half-way, if their colours or their light differ.",
        "ratio", "Keyframes",
    )  # fmt: skip
    key_iterations: int = Field(
        1, ge=1, le=20, title="Iterations between keys",
        description="Replaces `iterations` where painted keyframes are the style. One suffices, because frames start "
        "from advected keyframes; larger values take longer.",
        json_schema_extra={"unit": "rounds", "group": "Keyframes"},
    )  # fmt: skip
    key_search_radius: float = number(
        3, 1, 4096, "Search radius between keys",
        "Replaces `search_radius` where painted keyframes are the style.", "px", "Keyframes",
    )  # fmt: skip

    # -- search
    patch_radius: int = Field(
        4, ge=1, le=7, title="Patch radius",
        description="Radius of the compared neighbourhoods, which are 2 radius + 1 px wide. Larger values reproduce "
        "coarser texture and take longer.",
        json_schema_extra={"unit": "px", "group": "Search", "symbol": "Omega"},
    )  # fmt: skip
    patch_sigma: float = number(
        3, 0.5, 10, "Patch fall-off",
        "Standard deviation of the Gaussian that weights the pixels of a neighbourhood. Larger values weight its "
        "border more.", "px", "Search", "sigma",
    )  # fmt: skip
    levels: int = Field(
        4, ge=1, le=7, title="Levels",
        description="Number of resolutions from coarse to fine, each twice the one before. Larger values match larger "
        "structures of the style.",
        json_schema_extra={"unit": "levels", "group": "Search"},
    )  # fmt: skip
    iterations: int = Field(
        4, ge=1, le=20, title="Iterations",
        description="Rounds of PatchMatch per frame, level and sweep. Larger values find better positions and take "
        "longer.",
        json_schema_extra={"unit": "rounds", "group": "Search"},
    )  # fmt: skip
    sweeps: int = Field(
        1, ge=1, le=4, title="Sweeps",
        description="Pairs of sweeps, backward and forward through time, per level. Larger values agree better over "
        "long shots and take longer.",
        json_schema_extra={"unit": "pairs", "group": "Search"},
    )  # fmt: skip
    sweep_order: Literal["backward-first", "forward-first"] = choice(
        "backward-first", "Order of sweeps",
        "Direction in time of the first sweep of each pair. backward-first flickers less, because the last sweep then "
        "goes forward as viewers do; forward-first is the order in the paper. Between keyframes: always forward-first.",
        "Search",
    )  # fmt: skip
    refinement: Literal["auto", "fast", "full"] = choice(
        "auto", "Refinement of fine levels",
        "fast = at the three finest levels, each frame continues the frame before it with at most two rounds in one "
        "forward sweep; the first frame of a shot has more. full = every level has all sweeps and iterations, as in "
        "the paper; flickers up to 4.3 % less and takes about twice as long. auto = fast for frames of at least 720 "
        "rows. Several sweeps, and the sweep order of the paper, are always full.",
        "Search",
    )  # fmt: skip
    random_search: Literal["alternate", "every"] = choice(
        "alternate", "Random search",
        "Rounds with a random search: alternate = every second one, but not the last of several; every = all, as in "
        "the paper, which takes longer.", "Search",
    )  # fmt: skip
    search_radius: float = number(
        128, 1, 4096, "Search radius",
        "Radius of the random search in the style at all but the coarsest level. Larger values find positions farther "
        "away.", "px", "Search",
    )  # fmt: skip

    @property
    def frames_per_painting(self) -> int:
        """Number of frames that show the same painting."""
        return 2 if self.on_twos == "on" else 1
