"""Options that several commands share, the parsing of their values."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol, TypeVar

import typer
from pydantic import JsonValue

from impasto.delivery import expanded
from pipeline.errors import BadInput, BadParameter
from pipeline.formats import OUTPUTS, PASS_FORMATS
from pipeline.video.media import SourceOptions
from workers.contract.request import Json

if TYPE_CHECKING:
    from impasto_client import Client
    from pipeline.video.sequence_options import SequenceOptions


class DamagePolicy(StrEnum):
    """Behaviour of a job if frames of an input are missing or unreadable."""

    WARN = "warn"
    FAIL = "fail"


class FieldOrder(StrEnum):
    """Treatment of interlaced fields: see `pipeline.video.media.SourceOptions`."""

    AUTO = "auto"
    PROGRESSIVE = "progressive"
    TOP = "top"
    BOTTOM = "bottom"


class OpacityChoice(StrEnum):
    """Opacity of the film: see `workers.contract.request.Alpha`."""

    AUTO = "auto"
    SOURCE = "source"
    PAINTED = "painted"
    NONE = "none"


class ReadingFlags(Protocol):
    """Options of a command about how the video is read."""

    @property
    def video_stream(self) -> int | None: ...
    @property
    def sound_track(self) -> list[int] | None: ...
    @property
    def fields(self) -> FieldOrder: ...
    @property
    def premultiplied(self) -> bool: ...
    @property
    def colour_in(self) -> str: ...
    @property
    def colour_view(self) -> str: ...


def source_of(given: ReadingFlags) -> SourceOptions:
    """Options for reading the video."""
    return SourceOptions(
        given.video_stream, tuple(given.sound_track) if given.sound_track else None, given.fields.value,
        given.premultiplied, colour=given.colour_in, colour_view=given.colour_view,
    )  # fmt: skip


class VectorConvention(StrEnum):
    """Conventions of motion vectors: see `pipeline.video.sequence_options`."""

    AUTO = "auto"
    OFF = "off"
    BLENDER = "blender"
    NUKE = "nuke"


class MissingPolicy(StrEnum):
    """Treatment of missing numbers of an image sequence: see `pipeline.video.sequence_options`."""

    FAIL = "fail"
    HOLD = "hold"
    SKIP = "skip"


WHERE, WHAT = "Where", "What to paint"

MethodOption = Annotated[str, typer.Option("--method", "-m", help="See `impasto methods`.", rich_help_panel=WHAT)]
ParamOption = Annotated[
    list[str] | None,
    typer.Option(
        "--param",
        "-p",
        metavar="NAME=VALUE",
        rich_help_panel=WHAT,
        help="A parameter of the method; repeatable. Values over time: vividness=0:0.2,48:0.9 (frame:value), or JSON.",
    ),
]
InputOption = Annotated[
    list[str] | None,
    typer.Option("--input", "-i", metavar="NAME=PATH", help="Another input: a file or a folder.", rich_help_panel=WHAT),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of all random choices.", rich_help_panel=WHAT)]
QualityOption = Annotated[
    int, typer.Option(min=0, max=51, help="Rate factor of the video codec: lower is better.", rich_help_panel=WHAT)
]
FormatOption = Annotated[
    str, typer.Option("--format", help=f"Format of the film: {', '.join(OUTPUTS)}.", rich_help_panel=WHAT)
]
ProfileOption = Annotated[
    str,
    typer.Option(
        help="Encoding of the format: 4444, dnxhr-hqx, hevc, 16, ... (`impasto formats`).", rich_help_panel=WHAT
    ),
]
PremultipliedOption = Annotated[
    bool,
    typer.Option(
        "--premultiplied",
        help="The colours of IN are multiplied by its opacity (of some formats it always is).",
        rich_help_panel=WHAT,
    ),
]
AlphaOption = Annotated[
    OpacityChoice,
    typer.Option(
        help="Opacity of the film: that of IN (source), of the paint (painted), none (IN over white), or source if the "
        "profile has opacity.", rich_help_panel=WHAT,
    ),
]  # fmt: skip
PassesOption = Annotated[
    str,
    typer.Option(
        "--passes", metavar="NAME,...", help="Also save passes of the method, such as flow,labels; `impasto methods "
        "NAME` lists them.", rich_help_panel=WHAT,
    ),
]  # fmt: skip
PassesFormatOption = Annotated[
    str,
    typer.Option(
        "--passes-format", metavar="|".join(PASS_FORMATS), help=f"Format of the passes; default: {PASS_FORMATS[0]}, an "
        "image a frame with a layer for each pass; film: layers in the film's own images.", rich_help_panel=WHAT,
    ),
]  # fmt: skip
ColourInOption = Annotated[
    str,
    typer.Option(
        "--colour-in", metavar="SPACE", help="Colour space of IN, a name of OpenColorIO: ACEScg, \"ARRI LogC4\", ...; "
        "default: as IN says.", rich_help_panel=WHAT,
    ),
]  # fmt: skip
ColourViewOption = Annotated[
    str,
    typer.Option(
        "--colour-view", metavar="VIEW", help="View of OpenColorIO through which HDR and scene-linear IN is painted: "
        "\"ACES 2.0 - SDR 100 nits (Rec.709)\"; default: no tone map.", rich_help_panel=WHAT,
    ),
]  # fmt: skip
ColourOutOption = Annotated[
    str,
    typer.Option(
        "--colour-out", metavar="SPACE", help="Colour space of the film, for films of deep images; PQ or HLG for "
        "10-bit video; default: sRGB, BT.709, linear Rec. 709 if images are floating point.", rich_help_panel=WHAT,
    ),
]  # fmt: skip
DamageOption = Annotated[
    DamagePolicy,
    typer.Option(
        help="If frames of an input are missing or unreadable: use what can be read, or fail.", rich_help_panel=WHAT
    ),
]
PictureOption = Annotated[
    int | None,
    typer.Option(
        "--video-stream", metavar="N", min=0, help="Which video stream of IN, from 0; default: the main one.",
        rich_help_panel=WHAT,
    ),
]  # fmt: skip
SoundOption = Annotated[
    list[int] | None,
    typer.Option(
        "--sound-track", metavar="N", min=0, help="A sound track of IN to deliver, from 0; repeatable; default: all.",
        rich_help_panel=WHAT,
    ),
]  # fmt: skip
FieldsOption = Annotated[
    FieldOrder,
    typer.Option(
        help="Deinterlace what IN marks as interlaced, nothing, or everything, with the top or bottom field first.",
        rich_help_panel=WHAT,
    ),
]
MissingOption = Annotated[
    MissingPolicy | None,
    typer.Option(help="Numbers that a sequence of images lacks: fail (default), hold the frame before, or skip them.",
                 rich_help_panel=WHAT),
]  # fmt: skip
FpsOption = Annotated[
    str | None,
    typer.Option(metavar="RATE", help="Frames per second of a sequence of images: 25, 24000/1001; default 24.",
                 rich_help_panel=WHAT),
]  # fmt: skip
FramesOption = Annotated[
    str,
    typer.Option(
        metavar="FIRST:END",
        help="Render only these frames of IN: 10:60 (from 0, without END), #1001-#1048 (numbers of images), or "
        "01:00:00:00-01:00:02:00 (timecode, without END).",
    ),
]
LayerOption = Annotated[str | None, typer.Option(help="Layer of multi-layer images to paint.", rich_help_panel=WHAT)]
ViewOption = Annotated[str | None, typer.Option(help="View of stereo images to paint.", rich_help_panel=WHAT)]
VectorsOption = Annotated[
    VectorConvention | None,
    typer.Option(help="Convention of motion vectors in the frames; auto = found by warping.", rich_help_panel=WHAT),
]
HomeOption = Annotated[
    Path | None,
    typer.Option(help="Folder for data; default: IMPASTO_HOME, or your data folder.", rich_help_panel=WHERE),
]
DatabaseOption = Annotated[
    str | None,
    typer.Option(
        metavar="URL",
        help="postgresql://...; default: IMPASTO_DATABASE_URL, or SQLite in the home.",
        rich_help_panel=WHERE,
    ),
]
BlobsOption = Annotated[
    str | None, typer.Option(metavar="URL", help="s3://bucket/prefix; default: a folder in the home.")
]
S3EndpointOption = Annotated[
    str | None, typer.Option(metavar="URL", help="Endpoint of an S3 server other than Amazon's.")
]
ServerOption = Annotated[
    str | None,
    typer.Option(
        metavar="URL", help="Address of the service; default: IMPASTO_SERVER, or this machine.", rich_help_panel=WHERE
    ),
]
KeyOption = Annotated[str | None, typer.Option(help="API key; default: IMPASTO_API_KEY.", rich_help_panel=WHERE)]
OverwriteFlag = Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")]
QuietFlag = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print one JSON object on the last line of stdout.")]


def home_of(given: Path | None) -> Path:
    """The home folder: from the flag, else from the environment, else the user's data folder."""
    from impasto.settings import CommandSettings, load

    return load(CommandSettings, home=given).home.expanduser().absolute()


def client_of(server: str | None, api_key: str | None) -> Client:
    """A client for the service that flags or the environment name."""
    from impasto.settings import CommandSettings, load
    from impasto_client import Client

    settings = load(CommandSettings, server=server, api_key=api_key)
    return Client(settings.server, settings.api_key.get_secret_value())


T = TypeVar("T")


def params_of(options: Sequence[str]) -> Json:
    """`["sigma_px=1.5", "lines=off"]` -> `{"sigma_px": 1.5, "lines": "off"}`.

    A value that is valid JSON is parsed, `0:0.2,48:0.9` are values over time, anything else is text: `off`, `on` and
    names need no quotes.
    """
    return _pairs(options, "--param", "sigma_px=1.5", _value)


def inputs_of(options: Sequence[str]) -> dict[str, Path]:
    """`["reference=wave.jpg"]` -> `{"reference": Path("wave.jpg")}`; `video` is the first argument, not an option."""
    found = _pairs(options, "--input", "reference=painting.jpg", lambda text: expanded(Path(text)))
    if "video" in found:
        raise BadInput(
            "The input 'video' is the first argument.",
            field="--input",
            value=f"video={found['video']}",
            remedy="Give the video as IN, without --input.",
        )
    return found


def sequence_of(
    missing: MissingPolicy | None, fps: str | None, layer: str | None, view: str | None,
    vectors: VectorConvention | None = None,
) -> SequenceOptions:  # fmt: skip
    """Options for reading a sequence of images. Raises BadParameter that names the option."""
    from pipeline.video.sequence_options import options_of

    given = {"missing": missing and missing.value, "fps": fps, "layer": layer, "view": view}
    given["vectors"] = vectors and vectors.value
    return options_of({name: value for name, value in given.items() if value is not None}, "IN")


def labels_of(options: Sequence[str]) -> dict[str, str]:
    """`["shot=12"]` -> `{"shot": "12"}`."""
    return _pairs(options, "--label", "shot=12", str)


def extracted_of(options: Sequence[str]) -> dict[str, Path]:
    """`["matte:Cube=cube.zip"]` -> `{"matte:Cube": Path("cube.zip")}`."""
    return _pairs(options, "--extract", "matte:Cube=cube.zip", lambda text: expanded(Path(text)))


def artefacts_of(options: Sequence[str]) -> dict[str, Path | None]:
    """`["svg", "labels=out/labels.zip"]` -> `{"svg": None, "labels": Path("out/labels.zip")}`."""
    named = [option if "=" in option else f"{option}=" for option in options]
    return _pairs(named, "--artefact", "svg=frames.zip", lambda text: expanded(Path(text)) if text else None)


def passes_of(text: str) -> tuple[str, ...]:
    """`"flow, labels"` -> `("flow", "labels")`."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def frames_of(text: str, source: Path, sequence: SequenceOptions | None = None) -> tuple[int, int] | None:
    """`"10:60"` -> `(10, 60)`, first frame and one past the last; also numbers of images and timecode of `source`.

    Args:
        sequence: how images are read.

    Raises: BadParameter, and for numbers and timecode BadMedia.
    """
    from impasto.ranges import facts_of, span_of

    span = span_of(text)
    if span is None:
        return None
    if span.kind == "count":
        return int(span.first), int(span.end)
    from pipeline.video.sequence_options import USUAL

    return span.resolve(facts_of(expanded(source), sequence or USUAL), "--frames")


def _pairs(options: Sequence[str], flag: str, example: str, read: Callable[[str], T]) -> dict[str, T]:
    found: dict[str, T] = {}
    for option in options:
        name, equals, text = option.partition("=")
        name = name.strip()
        if not name or not equals:
            raise BadParameter("NAME=VALUE is expected.", field=flag, value=option, remedy=f"Write {flag} {example}.")
        if name in found:
            raise BadParameter(f"{name!r} is given twice.", field=flag, value=option, remedy="Give it once.")
        found[name] = read(text)
    return found


def _value(text: str) -> JsonValue:
    if _KEYS.fullmatch(text):
        pairs = (key.split(":") for key in text.split(","))
        return [[int(frame), float(value)] for frame, value in pairs]
    try:
        value: JsonValue = json.loads(text)
        return value
    except ValueError:
        return text


_KEY = r"\d+:-?\d+(\.\d+)?"
_KEYS = re.compile(f"{_KEY}(,{_KEY})*")
