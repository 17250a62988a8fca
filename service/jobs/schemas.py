"""Request and response bodies of jobs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.formats import PASS_FORMATS, OutputName
from service.prefix import Address
from workers.contract.record import Job
from workers.contract.request import (
    MAX_LABEL_NAME,
    MAX_LABEL_VALUE,
    MAX_LABELS,
    MAX_NAME,
    MAX_PRIORITY,
    MAX_QUALITY,
    MAX_SEED,
    MAX_URL,
    Alpha,
    JobRequest,
    Json,
    OutputSpec,
)
from workers.projects.document import Reading

Name = Annotated[str, Field(min_length=1, max_length=MAX_LABEL_NAME, pattern=r"^[A-Za-z0-9._-]+$")]
Frame = Annotated[int, Field(ge=0, le=10_000_000)]
AssetRef = Annotated[str, Field(min_length=1, max_length=100)]


PROFILE: str = Field(
    default="", max_length=32, description="Encoding of the format, for example `4444`; empty: its usual one."
)
ALPHA: Alpha = Field(
    default="auto",
    description="Opacity of the film. `source`: that of the video, whose colours are painted without a background; "
    "`painted`: that of the method, if it makes one; `none`: the video is painted over white; `auto`: `source` if the "
    "profile has opacity, else `none`.",
)


COLOUR: str = Field(
    default="", max_length=200,
    description="Colour space of the film. Images of more than 8 bits: a name of the OpenColorIO configuration, for "
    "example `ACEScg`. Video of more than 8 bits: `PQ` or `HLG` (BT.2100). Empty: sRGB, BT.709, and linear Rec. 709 "
    "in floating point.",
)  # fmt: skip


PASSES: tuple[Name, ...] = Field(
    default=(), max_length=64,
    description="Passes of the method beside the film, for example `flow`: names of `makes_passes` of the method. The "
    "job then has the artefact `passes`, a zip.",
)  # fmt: skip
PASSES_FORMAT: str = Field(
    default="", max_length=32,
    description=f"Format of the passes: {', '.join(PASS_FORMATS)}. Empty: the first one, an image a frame with a "
    "layer for each pass. `film`: layers in the film's own images, if these can hold any; the job then has no artefact "
    "`passes`.",
)  # fmt: skip


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OutputIn(_Body):
    format: OutputName = "mp4"
    quality: int = Field(default=20, ge=0, le=MAX_QUALITY, description="Constant rate factor, 0 (lossless) to 51.")
    artefacts: tuple[Name, ...] = Field(default=(), max_length=32)
    report: bool = Field(
        default=False,
        description="Measure flicker, detail, structure, edge width and faces on sampled frames; see `report.json`.",
    )

    profile: str = PROFILE
    alpha: Alpha = ALPHA

    colour: str = COLOUR

    passes: tuple[Name, ...] = PASSES
    passes_format: str = PASSES_FORMAT

    def spec(self) -> OutputSpec:
        return OutputSpec(**{name: getattr(self, name) for name in type(self).model_fields})


class ExportIn(_Body):
    format: OutputName = Field(description="The film's frames, times and sound, converted: not rendered again.")
    quality: int = Field(default=20, ge=0, le=MAX_QUALITY, description="Constant rate factor, 0 (lossless) to 51.")

    profile: str = PROFILE
    alpha: Alpha = ALPHA

    colour: str = COLOUR

    def spec(self) -> OutputSpec:
        return OutputSpec(self.format, self.quality, profile=self.profile, alpha=self.alpha, colour=self.colour)


class Work(_Body):
    """Method, inputs, parameters and seed: the common part of a job and a preview."""

    method: str = Field(min_length=1, max_length=64)
    inputs: dict[Name, AssetRef] = Field(max_length=64, description="Input name -> asset id.")
    params: Json = Field(
        default_factory=dict, max_length=256,
        description="Parameters of the method by name. A number whose schema has `varies` may be a list of keys: "
        "[[frame, value], ...].",
    )  # fmt: skip
    seed: int = Field(default=0, ge=0, le=MAX_SEED)


class JobIn(Work):
    frames: tuple[Frame, Frame] | None = Field(default=None, description="[first, end) of the video; null: all.")
    output: OutputIn = OutputIn()
    priority: int = Field(default=0, ge=-MAX_PRIORITY, le=MAX_PRIORITY, description="Higher first.")
    name: str = Field(default="", max_length=MAX_NAME)
    labels: dict[Name, Annotated[str, Field(max_length=MAX_LABEL_VALUE)]] = Field(
        default_factory=dict, max_length=MAX_LABELS
    )
    webhook: str = Field(
        default="", max_length=MAX_URL, description="http(s) URL that receives a message when the job ends."
    )

    on_damage: Literal["warn", "fail"] = Field(
        default="warn",
        description="If frames of an input are missing or unreadable: use what can be read and add a warning to the "
        "job, or fail with the code `damaged-media`.",
    )

    source: Reading = Reading()

    def request(self) -> JobRequest:
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return JobRequest(**values | {"output": self.output.spec(), "source": self.source.options()})


class PreviewIn(Work):
    frame: int = Field(default=0, ge=0, le=10_000_000, description="Which frame of the video, from 0.")
    max_side_px: int = Field(default=640, ge=16, le=2048)
    documents: dict[str, Json] = Field(
        default={}, max_length=16, description="JSON documents by input, instead of uploaded ones."
    )
    artefacts_of: str | None = Field(
        default=None, max_length=100, description="A job of the same method whose artefacts this preview builds on."
    )
    source: Reading = Reading()

    def request(self) -> JobRequest:
        return JobRequest(self.method, self.inputs, self.params, self.seed, source=self.source.options())


@dataclass(frozen=True)
class Links:
    self: Address
    events: Address
    result: Address
    tasks: Address


@dataclass(frozen=True)
class JobOut(Job):
    """A job with the addresses of its events, result and tasks."""

    links: Links


def job_out(job: Job) -> JobOut:
    at = f"/v1/jobs/{job.id}"
    own = {field.name: getattr(job, field.name) for field in fields(Job)}
    return JobOut(**own, links=Links(at, f"{at}/events", f"{at}/result", f"{at}/tasks"))


@dataclass(frozen=True)
class FileOut:
    """A file of a job."""

    name: str
    size_bytes: int
    media_type: str
    filename: str
    etag: str
    url: Address


@dataclass(frozen=True)
class LogOut:
    task_id: str
    log: str
