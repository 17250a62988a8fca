"""The API's JSON objects: made from the OpenAPI document by `python client/make_models.py`, do not edit.

A service of another version may have more fields, or lack some.
"""

from __future__ import annotations

from typing import Any, Literal, TypedDict

RunState = Literal["queued", "running", "paused", "succeeded", "failed", "cancelled"]


class OutputSpec(TypedDict):
    """The output of a job."""

    format: str
    quality: int
    artefacts: list[str]
    report: bool
    profile: str
    alpha: Literal["auto", "source", "painted", "none"]
    colour: str
    passes: list[str]
    passes_format: str


class SourceOptions(TypedDict):
    """Options for reading a video file. Attributes: picture: which of its video streams, counted from 0 without
    cover pictures; None: FFmpeg's choice. sound: which of its sound tracks are delivered, counted from 0; None:
    all. fields: "auto": pictures that the file marks as interlaced are deinterlaced; "progressive": none are;
    "top", "bottom": all are, and this field is the first one. premultiplied: whether the colours of pictures with
    opacity are multiplied by it, in formats that do not prescribe it. opacity: what frames show of pictures with
    opacity: "white": the picture over white; "straight": its colours, continued where it is transparent; "matte":
    the opacity, as a gray frame. Chosen by the job, not the user. deep: whether frames are uint16 or float32 if
    the source has more than 8 bits a channel. Chosen by the job. colour: colour space of the pictures, a name of
    the OpenColorIO configuration; "": as the file says. colour_view: the view through which they are seen, a name
    of that configuration; "": no tone map."""

    picture: int | None
    sound: list[int] | None
    fields: Literal["auto", "progressive", "top", "bottom"]
    premultiplied: bool
    colour: str
    colour_view: str


class JobRequest(TypedDict):
    """A submitted job. `inputs` maps input names of the method to asset ids."""

    method: str
    inputs: dict[str, str]
    params: dict[str, Any]
    seed: int
    output: OutputSpec
    priority: int
    name: str
    labels: dict[str, str]
    webhook: str
    frames: list[int] | None
    on_damage: str
    source: SourceOptions


class Step(TypedDict):
    """A step of a job: its tasks by state, and wall seconds of its stages (summed over tasks)."""

    name: str
    title: str
    state: str
    counts: dict[str, int]
    progress: float
    seconds: float
    stages: dict[str, float]
    reused: int
    cpu_s: float
    peak_bytes: int


class Fault(TypedDict):
    """Why something failed: a stable code, a message, and a remedy."""

    code: str
    message: str
    remedy: str
    field: str
    value: str | None


class JobWarning(TypedDict):
    """A fact that the user of a job should know although the job continues."""

    code: str
    message: str
    input: str
    damage: dict[str, Any]


class Links(TypedDict):
    self: str
    events: str
    result: str
    tasks: str


class Job(TypedDict):
    """A job with the addresses of its events, result and tasks."""

    id: str
    state: RunState
    request: JobRequest
    owner: str
    created_at: float
    updated_at: float
    started_at: float | None
    finished_at: float | None
    progress: float
    eta_s: float | None
    counts: dict[str, int]
    steps: list[Step]
    error: Fault | None
    results: list[str]
    warnings: list[JobWarning]
    links: Links


class Asset(TypedDict):
    """An uploaded file. `id` is `ast_` + SHA-256 of the bytes in hex: the same bytes are the same asset."""

    id: str
    sha256: str
    size_bytes: int
    filename: str
    media_type: str
    kind: str
    info: dict[str, Any]
    created_at: float
    owner: str


class When(TypedDict):
    """Conditions that must all hold. Attributes: params: parameter -> values of which it must have one. above:
    parameter -> number that its value must exceed, somewhere in the film. inputs: names of inputs of which one
    must be given. without: names of inputs of which none may be given. without_passes: kinds of render passes
    (`PassFacts.kinds`) of which the video may have none. way: the way in which frames are painted."""

    params: dict[str, list[str]]
    above: dict[str, float]
    inputs: list[str]
    without: list[str]
    way: Literal["", "film", "piece"]
    without_passes: list[str]


class Fits(TypedDict):
    """Other inputs whose size or length an input must match. Attributes: size: the input whose frame size it must
    have; aspect: the input whose aspect ratio it must have. frames: the input of whose frames it needs one for
    each; exactly: and no more."""

    size: str
    aspect: str
    frames: str
    exactly: bool


class InputSpec(TypedDict):
    """An input of a method. The video to be stylised is always named `video`. Attributes: part: the part of a
    project's layer (`Method.parts`) from which the input is made. Of kind "images": the part and a member of its
    pictures, such as "keys.mask". Of kind "json": the part, which `part_documents` may convert. Empty: a file
    that the layer names in its own `inputs`. preview: whether the input takes part in a preview of a single
    frame. A preview refuses inputs that do not. needs: name of another input that is required if this one is
    given; empty: none. applies_when: the conditions under which the input has an effect; empty: always. A live
    session takes pictures and JSON, unless a condition has a `way`. fits: what it must have in common with other
    inputs."""

    name: str
    kind: Literal["video", "image", "image-or-video", "images", "json"]
    required: bool
    title: str
    help: str
    part: str
    preview: bool
    needs: str
    applies_when: list[When]
    fits: Fits


class Example(TypedDict):
    """A preset: parameters with a name that users recognise. The API lists it, the page offers it."""

    name: str
    title: str
    params: dict[str, Any]


class MadePass(TypedDict):
    """A pass that a method can make of every frame. Attributes: name: in requests, and of the layer in files;
    [a-z-]. help: what it holds, one sentence. channels: names of its channels in the layer. unit: of its values,
    for example "px". ids: whether values are whole numbers, 0 = none; else they are floating point. png_zero,
    png_scale: the number `png_zero + png_scale * value`, 0..65535, stands in a PNG. Whole numbers have 65536 G +
    R instead."""

    name: str
    help: str
    channels: list[str]
    unit: str
    ids: bool
    png_zero: float
    png_scale: float


class StepOut(TypedDict):
    name: str
    title: str


class PartOut(TypedDict):
    name: str
    title: str


class Mark(TypedDict):
    """A colour of marks. `colour`: "#rrggbb"; `title`: what is marked with it, after "the"."""

    title: str
    colour: str


class Overlay(TypedDict):
    """A picture that the studio can draw over the stage. Attributes: kind: `mask` = a veil over what is black in it,
    `marks` = marks where the film has them (`Method.move_marks`), `labels` = a colour for each label of a label
    map, and a lane of the labels' uncertainty below the filmstrip. title: of the switch that shows it. preview:
    kind of the preview that computes it. after: parts of the layer on which it depends, so that a change of them
    makes it old. artefact: optional artefact with the label maps of a finished film, `<frame of six digits>.png`;
    empty: none. uncertainty: optional artefact with the uncertainty of its labels, JSON: frame -> label -> 0..1;
    empty: none."""

    kind: Literal["mask", "marks", "labels"]
    title: str
    preview: Literal[
        "paint",
        "source",
        "styles",
        "cuts",
        "flicker",
        "keys",
        "propagate",
        "regions",
        "directions",
        "clusters",
        "spread",
        "object",
        "matte",
    ]
    after: list[str]
    artefact: str
    uncertainty: str


class Slider(TypedDict):
    """A parameter of a region's style: its name in the document, and the range that the studio offers. Attributes:
    about: a sentence on what it does, with its unit. basic: whether it is shown at first; the others are in a
    group that opens. circular: whether it is an angle in degrees, which changes the shorter way round. param: the
    method's parameter that changes it in all regions whose key names no style; empty: none. by: how that
    parameter changes it: as a factor, or as a sum."""

    name: str
    title: str
    minimum: float
    maximum: float
    step: float
    about: str
    basic: bool
    circular: bool
    param: str
    by: Literal["factor", "sum"]


class Choice(TypedDict):
    """A value, and what the studio calls it. Attributes: values: of a style: its number for each slider, by the
    slider's name. technique: of a style: its other numbers, which have no slider and change between keys as those
    do."""

    value: str
    title: str
    values: dict[str, float]
    technique: dict[str, float]


class Section(TypedDict):
    """A section of the panel: an editor of one part of the layer, with what belongs to it in the filmstrip.
    Attributes: editor: `keys` = frames that the artist paints (`PaintedKeys`), `marks` = marks on frames
    (`Drawings`), `clusters` = found clusters and their corrected label maps (`Drawings` that may have `solve`,
    the frames that one changes), `regions` = a document with regions, styles, keys and directions
    (docs/multistyle.md), `histogram` = a colour scheme (docs/abstraction.md, "Inputs"), on the live page, too.
    part: name of the part in `Method.parts`. title, hint: heading, and a sentence of help below it. `regions` has
    its own. marks: colours of the editor `marks`. overlay: drawn over the stage while the section is shown.
    sliders: parameters of styles in the editor `regions`. styles: those that a region can have; `style_param` is
    the method's parameter with the same values. replaces: the method's parameters that a ready-made document
    (`Method.input_examples`) makes needless."""

    editor: Literal["keys", "marks", "clusters", "regions", "histogram"]
    part: str
    title: str
    hint: str
    marks: list[Mark]
    overlay: Overlay | None
    sliders: list[Slider]
    styles: list[Choice]
    style_param: str
    replaces: list[str]


class Studio(TypedDict):
    """Besides files, parameters and presets, which every method has. Attributes: sections: in the order of the
    panel. tools: tools of the stage besides moving and magnifying the picture, in the order of the toolbar.
    `object` fills what is clicked, or in a box; it is shown while the service makes previews, `label` once
    clusters are found, `region` while the service can find regions. painting: input that takes a painting of the
    style library; empty: none. painting_source: input that takes the picture which that painting shows; empty:
    none. cuts: parameter that sets how readily cuts are found, at most 1 by default; empty: cuts are found alike
    always."""

    sections: list[Section]
    tools: list[
        Literal[
            "brush", "eraser", "smudge", "fill", "picker", "object", "label", "region", "lasso", "correct", "direction"
        ]
    ]
    painting: str
    painting_source: str
    cuts: str


class Method(TypedDict):
    name: str
    title: str
    summary: str
    paper: str
    inputs: list[InputSpec]
    params_schema: dict[str, Any]
    defaults: dict[str, Any]
    examples: list[Example]
    artefacts: list[str]
    makes_passes: list[MadePass]
    steps: list[StepOut]
    parts: list[PartOut]
    previews: list[
        Literal[
            "paint",
            "source",
            "styles",
            "cuts",
            "flicker",
            "keys",
            "propagate",
            "regions",
            "directions",
            "clusters",
            "spread",
            "object",
            "matte",
        ]
    ]
    studio: Studio
    thumbnail: str


class ProjectLinks(TypedDict):
    self: str
    versions: str
    jobs: str
    export: str


class Project(TypedDict):
    """A project; only some routes include `document`."""

    id: str
    owner: str
    name: str
    version: int
    created_at: float
    updated_at: float
    deleted_at: float | None
    links: ProjectLinks
    document: dict[str, Any] | None


class ProjectJob(TypedDict):
    """A job of a project; `job` is null once it was deleted."""

    job: Job | None
    shot: str
    variant: str | None
    version: int
    at: float


class ProjectVersion(TypedDict):
    """One version of a project's document."""

    project_id: str
    version: int
    at: float
    author: str
    label: str
    size_bytes: int
    jobs: list[str]


class VersionOfProject(TypedDict):
    """A version with its document."""

    project_id: str
    version: int
    at: float
    author: str
    label: str
    size_bytes: int
    jobs: list[str]
    document: dict[str, Any]


TaskState = Literal["waiting", "ready", "running", "succeeded", "failed", "cancelled"]


class Task(TypedDict):
    id: str
    job_id: str
    step: str
    key: str
    state: TaskState
    progress: float
    attempts: list[dict[str, Any]]
    reused: bool


class OutputIn(TypedDict, total=False):
    format: Literal["mp4", "webm", "mov", "mkv", "mxf", "png", "tiff", "exr", "gif", "webp", "avif"]
    quality: int
    artefacts: list[str]
    report: bool
    profile: str
    alpha: Literal["auto", "source", "painted", "none"]
    colour: str
    passes: list[str]
    passes_format: str


class Reading(TypedDict, total=False):
    """How a video is read."""

    picture: int | None
    sound: list[int] | None
    fields: Literal["auto", "progressive", "top", "bottom"]
    premultiplied: bool
    colour: str
    colour_view: str


class JobOptions(TypedDict, total=False):
    seed: int
    frames: list[int] | None
    output: OutputIn
    priority: int
    name: str
    labels: dict[str, Any]
    webhook: str
    on_damage: Literal["warn", "fail"]
    source: Reading
