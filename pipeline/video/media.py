"""Properties of a media file (`MediaInfo`), its size limits (`Limits`), and the checks of these limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, NoReturn, Self

from pydantic import Field

from pipeline.errors import MediaTooLarge, UnreadableMedia
from pipeline.frames import MIN_SIDE_PX

if TYPE_CHECKING:
    from pydantic import JsonValue

Kind = Literal["video", "image", "archive", "json"]

SEQUENCE_FPS = 24
"""Frames per second assumed for image sequences, which store no rate: the rate of film."""


@dataclass(frozen=True)
class Limits:
    """Maximum size of a media file. All limits are inclusive."""

    size_bytes: int = 8 << 30
    pixels: int = 50_000_000
    """Maximum number of pixels of one frame."""
    side_px: int = 16384
    """Maximum width and height."""
    seconds: float = 2 * 3600.0
    frames: int = 1_000_000
    """Maximum number of frames, and of entries of an archive."""
    json_bytes: int = 16 << 20


READING = "reading"
"""Code of notes of still images and image sequences."""


class Note(NamedTuple):
    """A fact about a file that its user should know: what was chosen, corrected, assumed or left out."""

    code: str
    """"stream-choice", "corrected-times", "left-out", "assumed", "deinterlaced", "cropped", "sound" or `READING`."""
    message: str
    """One sentence."""


Fields = Literal["auto", "progressive", "top", "bottom"]
Opacity = Literal["white", "straight", "matte"]


@dataclass(frozen=True)
class SourceOptions:
    """Options for reading a video file.

    Attributes:
        picture: which of its video streams, counted from 0 without cover pictures; None: FFmpeg's choice.
        sound: which of its sound tracks are delivered, counted from 0; None: all.
        fields: "auto": pictures that the file marks as interlaced are deinterlaced; "progressive": none are;
            "top", "bottom": all are, and this field is the first one.
        premultiplied: whether the colours of pictures with opacity are multiplied by it, in formats that do not
            prescribe it.
        opacity: what frames show of pictures with opacity: "white": the picture over white; "straight": its colours,
            continued where it is transparent; "matte": the opacity, as a gray frame. Chosen by the job, not the user.
        deep: whether frames are uint16 or float32 if the source has more than 8 bits a channel. Chosen by the job.
        colour: colour space of the pictures, a name of the OpenColorIO configuration; "": as the file says.
        colour_view: the view through which they are seen, a name of that configuration; "": no tone map.
    """

    picture: int | None = None
    sound: tuple[int, ...] | None = None
    fields: Fields = "auto"
    premultiplied: bool = False
    opacity: Annotated[Opacity, Field(exclude=True)] = "white"
    deep: Annotated[bool, Field(exclude=True)] = False
    colour: str = ""
    colour_view: str = ""

    def as_json(self) -> dict[str, JsonValue]:
        sound: list[JsonValue] | None = None if self.sound is None else [*self.sound]
        given: dict[str, JsonValue] = {"picture": self.picture, "sound": sound, "fields": self.fields}
        # Services of earlier versions do not know these fields.
        more: dict[str, JsonValue] = {name: getattr(self, name) for name in _LATER if getattr(self, name)}
        return given | more if self.opacity == "white" else {**given, **more, "opacity": self.opacity}

    @classmethod
    def from_json(cls, value: dict[str, Any] | None) -> Self:
        """The inverse of `as_json`; None: the defaults."""
        if value is None:
            return cls()
        sound = value.get("sound")
        sounds = None if sound is None else tuple(sound)
        later = {name: value[name] for name in _LATER if name in value}
        return cls(value.get("picture"), sounds, value.get("fields", "auto"), opacity=value.get("opacity", "white"),
                   **later)  # fmt: skip


_LATER = ("premultiplied", "deep", "colour", "colour_view")
"""Fields of `SourceOptions` whose default is left out of its JSON."""


@dataclass(frozen=True)
class MediaInfo:
    """Result of probing. `width` and `height` are in px as displayed: after rotation, with square pixels."""

    kind: Kind
    media_type: str
    width: int = 0
    height: int = 0
    frames: int = 0
    fps: float = 0.0
    duration_s: float = 0.0
    codec: str = ""
    pixel_format: str = ""
    has_audio: bool = False
    sounds: int = 0
    """Number of sound tracks that can be decoded: see `SourceOptions.sound`."""
    rotation_deg: int = 0
    """Clockwise rotation for display, from the file's metadata: 0, 90, 180 or 270."""
    damage: str = ""
    """Damage that is visible without decoding the file, one sentence; empty: none."""
    notes: tuple[str, ...] = ()
    """Notes on what was chosen, corrected, assumed or left out when the file was read, one sentence each."""
    streams: tuple[dict[str, JsonValue], ...] = ()
    """Width, height, frames and so on of each video stream, if there are several: see `SourceOptions.picture`."""
    alpha: bool = False
    """Whether its pictures have opacity."""
    numbers: Sequence[Sequence[int]] = ()
    """Numbers of the images of a sequence or archive, as runs (first, last, step); empty: frames are counted from 0."""
    passes: Mapping[str, JsonValue] = field(default_factory=dict)
    """Render passes of a sequence, see `pipeline.passes.facts`; empty: it has none."""
    fault: Mapping[str, str] = field(default_factory=dict)
    """Why the images of an archive are no video: "message", "value", "remedy". Keys and masks need not be one."""

    def as_json(self) -> dict[str, JsonValue]:
        return asdict(self)


def opacity_notes(has_alpha: bool, options: SourceOptions) -> tuple[Note, ...]:
    """A note if the opacity of a file is not used."""
    if not has_alpha or options.opacity != "white":
        return ()
    return (Note("left-out", "The pictures have opacity: they were put over white."),)


def unreadable(message: str, value: object = None, remedy: str = "") -> NoReturn:
    """Raise `UnreadableMedia` for the field "file", with a default remedy."""
    remedy = remedy or "Upload a video (MP4, MOV, MKV, WebM, AVI), an image, or a zip of numbered images."
    raise UnreadableMedia(message, field="file", value=value, remedy=remedy)


def check_size(width: int, height: int, limits: Limits, what: str = "The picture") -> None:
    """Check a picture size before any allocation.

    Raises:
        UnreadableMedia: a side is shorter than `MIN_SIDE_PX`.
        MediaTooLarge: the picture exceeds the limits.
    """
    if width < MIN_SIDE_PX or height < MIN_SIDE_PX:
        unreadable(f"{what} is too small.", f"{width}x{height}", f"Use at least {MIN_SIDE_PX} px on each side.")
    check_window(width, height, limits, "file", what)


def check_window(width: int, height: int, limits: Limits, name: str, what: str = "") -> None:
    """Raise MediaTooLarge if a picture, of any small size, exceeds the limits; `name`: the field of the error."""
    if width * height > limits.pixels or max(width, height) > limits.side_px:
        raise MediaTooLarge(
            f"{what or f'The image {name}'} has too many pixels.", field=name, value=f"{width}x{height}",
            remedy=f"At most {limits.pixels / 1e6:g} megapixels and {limits.side_px} px a side: scale it down.",
        )  # fmt: skip


def check_bytes(size_bytes: int, most: int, name: str = "file") -> None:
    """Raise UnreadableMedia for an empty file, MediaTooLarge for one with more than `most` bytes; `name`: the field of
    the error."""
    if size_bytes == 0:
        raise UnreadableMedia("The file is empty.", field=name, value="0 bytes", remedy="Upload or render it again.")
    if size_bytes > most:
        remedy = f"At most {most / 2**20:.6g} MiB: shorten or compress it."
        raise MediaTooLarge("The file has too many bytes.", field=name, value=f"{size_bytes} bytes", remedy=remedy)


def check_length(frames: int, seconds: float, limits: Limits) -> None:
    """Raise MediaTooLarge if a video has more frames or seconds than the limits allow."""
    if seconds > limits.seconds or frames > limits.frames:
        raise MediaTooLarge(
            "The video is too long.",
            field="file",
            value=f"{seconds:.1f} s, {frames} frames",
            remedy=f"At most {limits.seconds:g} s and {limits.frames} frames: cut it.",
        )
