"""`impasto live`: a stream from a file, a camera or the network, stylised as it comes."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli.console import emit, err, out, print_status
from impasto.cli.option_classes import takes_options
from impasto.cli.options import (
    WHAT,
    WHERE,
    FieldOrder,
    FieldsOption,
    JsonFlag,
    KeyOption,
    MethodOption,
    OverwriteFlag,
    ParamOption,
    QualityOption,
    QuietFlag,
    SeedOption,
    ServerOption,
    inputs_of,
    params_of,
)
from pipeline.errors import BadInput
from pipeline.method_names import DEFAULT, DEFAULT_FILTER
from workers.contract.request import Json

if TYPE_CHECKING:
    from impasto.live.client import LiveClient
    from impasto.live.run import LiveStream
    from impasto.live.sink import Sink
    from impasto.live.sources import Source

EPILOG = """[bold]Examples[/bold]

impasto live --input camera --output window

impasto live --input clip.mp4 --output cartoon.mp4 --param lines=off

impasto live --input rtsp://camera.local/stream --output rtmp://studio.example/live/key --input reference=wave.jpg

impasto live --input clip.mp4 --loop forever --duration 60 --output none --json

Frames go out at the input's own pace; when the service cannot keep up, it drops some rather than fall behind, and
works at a lower resolution. Without --server a service on this machine is used, or one is started for the occasion.
Ctrl-C ends the stream; what has been written is whole.
"""

_NAMED = re.compile(r"[a-z_]+=")
_CODECS = ("jpeg", "webp", "h264", "vp8", "raw")

Inputs = Annotated[
    list[str],
    typer.Option(
        "--input", "-i", metavar="SOURCE | NAME=PATH", rich_help_panel=WHAT,
        help="A video file, camera, camera:1, or an address (rtsp://...); and another input of the method by its name.",
    ),
]  # fmt: skip
Output = Annotated[
    str,
    typer.Option(
        "--output", "-o", metavar="OUT", help="A .mp4 or .webm file, DIR/ (PNGs), rtmp://..., whip://..., window, none."
    ),
]


@dataclass(frozen=True, kw_only=True)
class LiveCommandOptions:
    """Options of `impasto live`."""

    inputs: Inputs
    output: Output = "window"
    method: MethodOption = DEFAULT
    param: ParamOption = None
    seed: SeedOption = 0
    size: Annotated[str, typer.Option(metavar="WxH", help="Scale the input.", rich_help_panel=WHAT)] = ""
    fps: Annotated[
        float | None, typer.Option(min=1, max=240, help="Frame rate of the input.", rich_help_panel=WHAT)
    ] = None
    fields: FieldsOption = FieldOrder.AUTO
    loop: Annotated[
        str, typer.Option(metavar="N|forever", help="Number of times to play a file.", rich_help_panel=WHAT)
    ] = "1"
    duration: Annotated[float | None, typer.Option(metavar="S", min=0.1, help="Stop after this many seconds.")] = None
    codec: Annotated[str, typer.Option(help=f"Both ways: {', '.join(_CODECS)}.", rich_help_panel=WHERE)] = "jpeg"
    prefer: Annotated[
        str,
        typer.Option(metavar="fluent|sharp", help="When frames take too long: lower the working size, or drop frames."),
    ] = "fluent"
    steady: Annotated[bool, typer.Option(f"--{DEFAULT_FILTER}", help="Remove flicker from the painted frames.")] = False
    quality: QualityOption = 20
    overwrite: OverwriteFlag = False
    server: ServerOption = None
    api_key: KeyOption = None
    quiet: QuietFlag = False
    as_json: JsonFlag = False


@takes_options(LiveCommandOptions)
def live(options: LiveCommandOptions) -> None:
    """Stylise a stream as it comes, through a live session of a service."""
    from impasto.live.client import LiveClient
    from impasto.live.plain_sinks import open_sink
    from impasto.live.service import service
    from impasto.live.sources import open_source
    from impasto.settings import CommandSettings, load

    source_name, named = _split(options.inputs)
    params, size, loops = params_of(options.param or []), _size(options.size), _loops(options.loop)
    _check_codec(options.codec)
    _check_preference(options.prefer)
    settings = load(CommandSettings, server=options.server, api_key=options.api_key)
    key = settings.api_key.get_secret_value()
    with _closing(open_source(source_name, loops, size, options.fps, options.fields.value)) as source:
        sink = open_sink(options.output, source, options.quality, options.overwrite)
        with service(settings.server, print_status) as address:
            session: Json = {
                "size": source.size, "fps": max(source.fps, 1.0), "method": options.method, "params": params,
                "inputs": _upload(address, key, named), "seed": options.seed, "send": (options.codec,),
                "receive": (options.codec,), "prefer": options.prefer,
                "filter": {"method": DEFAULT_FILTER} if options.steady else None,
            }  # fmt: skip
            with _status(options.quiet) as show:
                client = LiveClient(address, key, show, **session)
                summary = _stream(client, source, sink, options.duration or float("inf"))
    _print_summary(summary, options.as_json)


def _stream(client: LiveClient, source: Source, sink: Sink, duration_s: float) -> Json:
    from impasto.live.run import LiveStream

    with client:
        stream = LiveStream(client, source, sink, duration_s)
        with _stop_on_signal(stream):
            where = stream.run()
        return _summary(stream, client, where)


@contextmanager
def _stop_on_signal(stream: LiveStream) -> Iterator[None]:
    """Ctrl-C (or SIGTERM) ends the stream regularly; a second one ends it at once."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def end(_number: int, _frame: FrameType | None) -> None:
        restore()
        stream.stop()

    for number in before:
        signal.signal(number, end)
    try:
        yield
    finally:
        restore()


def _summary(stream: LiveStream, client: LiveClient, where: str) -> Json:
    work = client.stats or client.ready
    return stream.tally.as_json() | {
        "width": stream.source.size[0], "height": stream.source.size[1],
        "work_width": work["width"], "work_height": work["height"],
        "codec": client.ready["receive"]["codec"], "session": client.ready["session"], "output": where,
    }  # fmt: skip


def _print_summary(summary: Json, as_json: bool) -> None:
    if as_json:
        emit(summary)
        return
    if summary["output"] not in ("none", "window", ""):
        out.print(summary["output"], markup=False)
    latency = summary["server_latency_ms"]
    print_status(
        f"{summary['painted']} of {summary['frames']} frames, {summary['fps']:.1f} frames/s, "
        f"server {latency['p50']:.0f} ms (p99 {latency['p99']:.0f} ms)"
    )


@contextmanager
def _closing(source: Source) -> Iterator[Source]:
    try:
        yield source
    finally:
        source.close()


@contextmanager
def _status(quiet: bool) -> Iterator[Callable[[Json], None]]:
    """Print a status line once a second on a terminal; elsewhere only messages of the service."""
    if quiet:
        yield lambda message: None
    elif not err.is_terminal:
        yield _print_change
    else:
        with err.status("Connecting...") as line:
            yield lambda message: line.update(_line(message)) if message["type"] == "stats" else _print_change(message)


def _line(stats: Json) -> str:
    latency = stats["latency_ms"]
    return (
        f"{stats['fps']:.0f} frames/s at {stats['width']}x{stats['height']}, "
        f"server {latency['p50']:.0f} ms (p99 {latency['p99']:.0f} ms), {stats['dropped']} dropped"
    )


def _print_change(message: Json) -> None:
    if message["type"] == "resolution":
        print_status(f"Works at {message['width']}x{message['height']} now ({message['reason']}).")
    elif message["type"] == "replaced":
        print_status("The worker died; another one continues.")
    elif message["type"] == "error":
        print_status(f"error: {message['problem'].get('detail')}")


def _split(options: list[str]) -> tuple[str, dict[str, Path]]:
    """The source, and the method's other inputs by name."""
    named = [option for option in options if _NAMED.match(option)]
    sources = [option for option in options if option not in named]
    if len(sources) != 1:
        raise BadInput(
            "One source is expected.", field="--input", value=", ".join(sources) or "none",
            remedy="Give one of: a video file, camera, camera:1, rtsp://...; others as NAME=PATH.",
        )  # fmt: skip
    return sources[0], inputs_of(named)


def _size(text: str) -> tuple[int, int] | None:
    if not text:
        return None
    found = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if not found:
        raise BadInput("A size is WIDTHxHEIGHT.", field="--size", value=text, remedy="Write --size 640x480.")
    return int(found[1]), int(found[2])


def _loops(text: str) -> int:
    """Number of times that a file is played; 0 = without end."""
    if text == "forever":
        return 0
    if not text.isdecimal() or not int(text):
        raise BadInput(
            "The number of repetitions is invalid.", field="--loop", value=text, remedy="Write 3, or forever."
        )
    return int(text)


def _check_codec(codec: str) -> None:
    if codec not in _CODECS:
        raise BadInput("Codec not found.", field="--codec", value=codec, remedy=f"Use {', '.join(_CODECS)}.")


def _check_preference(prefer: str) -> None:
    if prefer not in ("fluent", "sharp"):
        raise BadInput("Preference not found.", field="--prefer", value=prefer, remedy="Write fluent, or sharp.")


def _upload(address: str, key: str, paths: Mapping[str, Path]) -> dict[str, str]:
    """Input name -> asset id."""
    from impasto.cli.input_files import upload
    from impasto_client import Client

    with Client(address, key) as client:
        return upload(client, paths, "--input ")
