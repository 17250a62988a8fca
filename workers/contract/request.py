"""The request of a job and its output, independent of HTTP and the database."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from pipeline.formats import output_format
from pipeline.formats.base import Profile
from pipeline.video.media import SourceOptions

Json = dict[str, Any]

MAX_SEED = 2**53 - 1
"""The largest integer that every JSON parser represents exactly."""

MAX_LABELS, MAX_LABEL_NAME, MAX_LABEL_VALUE = 32, 80, 200
"""Maximum number of labels of a job; maximum characters of a label's name and value."""

MAX_NAME, MAX_URL = 200, 2000
"""Maximum characters of a job's name and of a webhook's URL."""

MAX_PRIORITY = 100

EXPORT_LABEL = "export"
"""Label of an export (`farm.exports`): the id of the job whose film it converts."""

MAX_QUALITY = 51
"""Largest constant rate factor."""


Alpha = Literal["auto", "source", "painted", "none"]
"""Opacity of a film: "source": that of the source, whose colours are painted without their background; "painted": that
of the method, if it makes one; "none": the source is painted over white; "auto": "source" if the profile has opacity,
else "none"."""


@dataclass(frozen=True)
class OutputSpec:
    """The output of a job."""

    format: str = "mp4"
    """Name of an output format: see `pipeline.formats`."""
    quality: int = 20
    """Constant rate factor of the codec, 0 (lossless) to 51."""
    artefacts: tuple[str, ...] = ()
    """Optional artefacts of the method, for example "svg"."""
    report: bool = False
    """Whether the result is measured against the source (`pipeline.quality`)."""
    profile: str = ""
    """Encoding of the format, for example "4444": see `pipeline.formats`; "": its usual one."""
    alpha: Alpha = "auto"
    """Opacity of the film."""
    colour: str = ""
    """Colour space of the film, a name of the OpenColorIO configuration; "": that of the profile."""
    passes: tuple[str, ...] = ()
    """Passes of the method, see `Method.makes_passes`: the job then has the artefact `pipeline.passes.made.PASSES`."""
    passes_format: str = ""
    """Format of the passes, one of `PASS_FORMATS`; "": the first one, with a layer for each pass."""

    @property
    def encoding(self) -> Profile:
        return output_format(self.format).profile(self.profile)

    @property
    def keeps_opacity(self) -> bool:
        """Whether the film has the opacity of its source, if that has any."""
        return self.alpha in ("auto", "source") and self.encoding.has_alpha

    def asks_no_more_than(self, other: OutputSpec) -> bool:
        """Whether a job with the other output has all artefacts and passes that this one asks for, in its format."""
        extras = set(self.artefacts) <= set(other.artefacts) and set(self.passes) <= set(other.passes)
        return extras and (not self.passes or self.passes_format == other.passes_format)

    @property
    def reads_colours(self) -> bool:
        """Whether colours of the source are read without a background."""
        return self.keeps_opacity or self.alpha == "painted"


WARN, FAIL = "warn", "fail"
"""Values of `JobRequest.on_damage`."""


@dataclass(frozen=True)
class JobRequest:
    """A submitted job. `inputs` maps input names of the method to asset ids."""

    method: str
    inputs: dict[str, str]
    params: Json = field(default_factory=dict)
    seed: int = 0
    output: OutputSpec = field(default_factory=OutputSpec)
    priority: int = 0
    """-100..100, higher first."""
    name: str = ""
    labels: dict[str, str] = field(default_factory=dict)
    webhook: str = ""
    """URL that receives a message when the job ends, or empty."""
    frames: tuple[int, int] | None = None
    """[first, end) of the video; None: all. The job's inputs number frames as the whole video does."""
    on_damage: str = WARN
    """Behaviour if frames of an input are missing or unreadable: "warn" (use the readable frames, and add a warning to
    the job) or "fail" (the job fails with the code "damaged-media" before it paints them)."""
    source: SourceOptions = field(default_factory=SourceOptions)
    """Options for reading the input `video`: streams and fields."""
