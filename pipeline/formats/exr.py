"""OpenEXR: every channel of every part as a plane of the display window; the header; writing."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.colour.ocio import interop_id, linear
from pipeline.errors import ImpastoError, UnreadableMedia
from pipeline.formats.base import (
    Carries,
    Choice,
    ImageFormat,
    ImageHeader,
    OutputFormat,
    PlaneImage,
    Profile,
    aspect_notes,
    square_pixels,
)
from pipeline.frames import Plane
from pipeline.passes.cryptomatte import PREFIX
from pipeline.video.depth import as_float
from pipeline.video.media import Limits, check_window, unreadable
from pipeline.video.passes import picture, picture_choice

_DEEP = (OpenEXR.deepscanline, OpenEXR.deeptile)
_COLOUR_ATTRIBUTES = ("chromaticities", "colorInteropID")
_LINEAR_709 = "lin_rec709_scene"
_CHROMATICITIES_709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


class Exr(ImageFormat):
    name, title, media_type = "exr", "OpenEXR", "image/x-exr"
    suffixes = (".exr",)
    carries = Carries(alpha=True, depth_bits=32, planes=True)
    premultiplied = True

    def sniff(self, head: bytes) -> bool:
        return head.startswith(b"\x76\x2f\x31\x01")

    def header(self, stream: BinaryIO) -> ImageHeader:
        first = _headers(stream, "image")[0]
        return ImageHeader(self.media_type, *_extent(first["displayWindow"]))

    def notes(self, data: bytes, choice: Choice = Choice()) -> tuple[str, ...]:
        headers, named = _headers(io.BytesIO(data), "image"), self.channels(io.BytesIO(data))
        deep = [str(header.get("name")) for header in headers if header.get("type") in _DEEP]
        left = (f"Parts with deep pixels are left out: {', '.join(deep)}.",) if deep else ()
        return (*picture_choice(named, choice).notes, *_facts(headers[0], choice), *left)

    def read(self, data: bytes, limits: Limits, name: str, choice: Choice = Choice()) -> AnyArray:
        image = self.planes(data, limits, name)
        found = picture(image, choice)
        if found is None:
            layers = ", ".join(picture_choice(image, choice).layers)
            choose = f"Choose one of its layers: {layers}." if layers else "Render the Combined pass, or R, G and B."
            unreadable("The EXR file has no channels that are named as a picture.", name, choose)
        return square_pixels(found, image.pixel_aspect)

    def planes(self, data: bytes | Path, limits: Limits, name: str = "image") -> PlaneImage:
        """All channels: half, float or integer; single-part or multi-part. Pixels of the display window outside the
        data window are 0; channels of less resolution are enlarged.

        Raises:
            UnreadableMedia: the file is not an EXR, is damaged, or has deep channels.
            MediaTooLarge: a window is larger than the limits allow.
        """
        stream = io.BytesIO(data) if isinstance(data, bytes) else data.open("rb")
        with stream:
            headers = _headers(stream, name)
            for header in headers:
                for window in ("displayWindow", "dataWindow"):
                    check_window(*_extent(header[window]), limits, name)
            if all(header.get("type") in _DEEP for header in headers):
                unreadable("The EXR has deep pixels only.", name, "Flatten it: one value for each pixel and channel.")
            try:
                with OpenEXR.File(stream, separate_channels=True, num_threads=0) as file:
                    planes = _placed(file.parts, headers, name)
            except (ImpastoError, MemoryError):
                raise
            except Exception as error:  # the binding raises what OpenEXR's C++ does
                raise _unreadable(name, error) from error
        aspect = float(headers[0].get("pixelAspectRatio", 1.0))
        size, kept = _extent(headers[0]["displayWindow"]), _attributes(headers)
        return PlaneImage(size, planes, aspect, _views(headers), _to_709(headers[0]), kept)

    def written(self, planes: Mapping[str, Plane]) -> bytes:
        return exr_bytes(planes)

    def united(self, files: Sequence[bytes]) -> bytes:
        planes: dict[str, AnyArray] = {}
        for data in files:
            planes |= _stored(data)[1]
        return exr_bytes(planes)

    def with_planes(self, picture: bytes, planes: bytes) -> bytes:
        (header, colours), out = _stored(picture), io.BytesIO()
        kept = {key: header[key] for key in ("compression", "type", *_COLOUR_ATTRIBUTES) if key in header}
        with OpenEXR.File(kept, colours | _stored(planes)[1]) as file:
            file.write(out)
        return out.getvalue()

    def channels(self, stream: BinaryIO, name: str = "image") -> PlaneImage:
        """The names of all channels, views and attributes, without pixels: planes are empty. Raises UnreadableMedia."""
        headers = _headers(stream, name)
        flat = [header for header in headers if header.get("type") not in _DEEP]
        planes = {full: np.zeros((0, 0), np.float32) for header in flat for full in _names(header)}
        return PlaneImage(_extent(headers[0]["displayWindow"]), planes, 1.0, _views(headers), (), _attributes(headers))


EXR = Exr()


def _stored(data: bytes) -> tuple[dict[str, Any], dict[str, AnyArray]]:
    """The header and the planes of a file that this program has written, in their own types."""
    with OpenEXR.File(io.BytesIO(data), separate_channels=True, num_threads=0) as file:
        return dict(file.header()), {name: channel.pixels.copy() for name, channel in file.channels().items()}


def _unreadable(name: str, why: object) -> UnreadableMedia:
    return UnreadableMedia(
        "The EXR cannot be read.", field=name, value=why, remedy="Save it again as scanlines, with full channels."
    )


def _headers(stream: BinaryIO, name: str) -> list[Mapping[str, Any]]:
    """The headers of all parts; the stream is at its start before and after."""
    stream.seek(0)
    try:
        with OpenEXR.File(stream, header_only=True, num_threads=0) as file:
            found: list[Mapping[str, Any]] = [
                dict(part.header) for part in file.parts
            ]  # the file empties them at its end
    except Exception as error:  # the binding raises what OpenEXR's C++ does
        raise _unreadable(name, error) from error
    stream.seek(0)
    if not found or any(min(_extent(header["displayWindow"])) < 1 for header in found):
        raise _unreadable(name, "no part with a picture")
    return found


def _extent(window: Any) -> tuple[int, int]:
    (left, top), (right, bottom) = window
    return int(right) - int(left) + 1, int(bottom) - int(top) + 1


def _names(header: Mapping[str, Any]) -> list[str]:
    """Full names of a part's channels, "part.layer.pass.X"; a part's view becomes a component of the name."""
    parts = [part for part in (header.get("name"), header.get("view")) if part]
    return [_named(parts, channel.name) for channel in header["channels"]]


def _named(parts: list[str], channel: str) -> str:
    """The channel's name below its part, without components that it has already."""
    missing = [part for part in parts if not channel.startswith(f"{part}.") and part not in channel.split(".")[:-1]]
    return ".".join([*missing, channel])


def _attributes(headers: list[Mapping[str, Any]]) -> dict[str, str]:
    return {key: str(value) for header in headers for key, value in header.items() if key.startswith(PREFIX)}


def _views(headers: list[Mapping[str, Any]]) -> tuple[str, ...]:
    found = [view for header in headers for view in (header.get("multiView") or [header.get("view")]) if view]
    return tuple(dict.fromkeys(found))


def _placed(parts: list[Any], headers: list[Mapping[str, Any]], name: str) -> dict[str, Plane]:
    planes: dict[str, Plane] = {}
    for header, part in zip(headers, parts, strict=True):
        if header.get("type") in _DEEP:
            continue
        extent, size = _extent(header["dataWindow"]), _extent(header["displayWindow"])
        shift = np.array(header["dataWindow"][0]) - np.array(header["displayWindow"][0])
        for full, channel in zip(_names(header), header["channels"], strict=True):
            if channel.name not in part.channels:
                continue
            found = part.channels[channel.name]
            pixels = _upscaled(found.pixels, (found.xSampling, found.ySampling), extent)
            if pixels.ndim != 2 or pixels.shape[::-1] != extent:
                raise _unreadable(name, f"channel {channel.name}: deep, or of another size than its window")
            planes[full] = _within(pixels, (int(shift[0]), int(shift[1])), size)
    if not planes or len(parts) != len(headers):  # OpenEXR leaves out a part whose pixels it cannot decode
        raise _unreadable(name, "its pixels are cut off or damaged")
    return planes


def _upscaled(pixels: AnyArray, sampling: tuple[int, int], extent: tuple[int, int]) -> AnyArray:
    if sampling == (1, 1) or pixels.ndim != 2:
        return pixels
    return pixels.repeat(sampling[1], 0).repeat(sampling[0], 1)[: extent[1], : extent[0]]


def _within(pixels: AnyArray, shift: tuple[int, int], size: tuple[int, int]) -> Plane:
    """Copy the pixels of the data window into the display window."""
    if shift == (0, 0) and pixels.shape[::-1] == size:
        return np.ascontiguousarray(pixels, np.float32)
    out = np.zeros(size[::-1], np.float32)
    (left, top), (height, width) = shift, pixels.shape
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + width, size[0]), min(top + height, size[1])
    if x1 > x0 and y1 > y0:
        out[y0:y1, x0:x1] = pixels[y0 - top : y1 - top, x0 - left : x1 - left]
    return out


def _facts(header: Mapping[str, Any], choice: Choice) -> Iterator[str]:
    data, display = header["dataWindow"], header["displayWindow"]
    outside = (np.array(data[0]) < np.array(display[0])).any() or (np.array(data[1]) > np.array(display[1])).any()
    sizes = "{}x{}".format(*_extent(data)), "{}x{}".format(*_extent(display))
    if outside:
        yield f"The data window ({sizes[0]}) reaches beyond the display window ({sizes[1]}): the overscan is left out."
    elif sizes[0] != sizes[1]:
        yield f"The data window ({sizes[0]}) is smaller than the display window ({sizes[1]}): the rest is empty."
    yield from aspect_notes(float(header.get("pixelAspectRatio", 1.0)))
    space = _colour_space(header)
    white = f"shown through the view {choice.colour_view!r}" if choice.colour_view else "light above 1 is white"
    if choice.colour:
        yield f"The colours are read as {choice.colour}, as given; {white}."
    elif _to_709(header):
        yield f"The colours are {space}; they are converted to Rec. 709, and {white}."
    elif choice.colour_view:
        yield f"The colours are {space}; {white}."
    elif space != _LINEAR_709:
        yield f"The colours are {space}; they are read as linear Rec. 709, without conversion."


def _to_709(header: Mapping[str, Any]) -> tuple[tuple[float, ...], ...]:
    """Matrix from linear light in the primaries of the header, by its chromaticities or colour interop id, to that of
    Rec. 709; () if they are those, or unknown. White is adapted by the Bradford transform."""
    found = header.get("chromaticities")
    interop = str(header.get("colorInteropID") or "")
    if found is None and interop.startswith("lin_"):
        with suppress(Exception):  # an id that OpenEXR does not know
            found = OpenEXR.colorInteropIDToChromaticities(interop)
    if found is None or np.allclose(np.ravel(found), _CHROMATICITIES_709, atol=1e-3):
        return ()
    source, target = _to_xyz(np.ravel(found)), _to_xyz(np.array(_CHROMATICITIES_709))
    cones = [_BRADFORD @ each.sum(1) for each in (source, target)]
    adapted = np.linalg.inv(_BRADFORD) @ np.diag(cones[1] / cones[0]) @ _BRADFORD
    matrix = np.linalg.inv(target) @ adapted @ source
    return tuple(map(tuple, matrix.tolist())) if np.isfinite(matrix).all() else ()


def _to_xyz(chromaticities: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Matrix from linear RGB to CIE XYZ; arguments: x and y of red, green, blue and white. Source: SMPTE RP 177."""
    xy = np.asarray(chromaticities, np.float64).reshape(4, 2)
    xyz = np.column_stack([xy[:, 0], xy[:, 1], 1 - xy.sum(1)]).T
    white = xyz[:, 3] / xyz[1, 3]
    return np.asarray(xyz[:, :3] * np.linalg.solve(xyz[:, :3], white))


def _colour_space(header: Mapping[str, Any]) -> str:
    """The colour interop id of the header or of its chromaticities; Rec. 709 without any."""
    if interop := header.get("colorInteropID"):
        return str(interop)
    primaries = header.get("chromaticities")
    if primaries is None:
        return _LINEAR_709
    known = OpenEXR.chromaticitiesToColorInteropID(primaries)
    return str(known or "in unknown primaries " + ", ".join(f"{value:.4g}" for value in primaries))


def write_exr(path: Path, planes: Mapping[str, Plane], half: bool = False) -> None:
    """Write planes, by full channel name "pass.X", as a ZIP-compressed EXR in float32, or in float16 if `half`; planes
    of uint32 stay whole numbers."""
    path.write_bytes(exr_bytes(planes, half))


def exr_bytes(planes: Mapping[str, AnyArray], half: bool = False) -> bytes:
    """The contents of a file of `write_exr`."""
    kind, out = np.float16 if half else np.float32, io.BytesIO()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    kept = {
        name: np.ascontiguousarray(plane, plane.dtype if plane.dtype == np.uint32 else kind)
        for name, plane in planes.items()
    }
    with OpenEXR.File(header, kept) as file:
        file.write(out)
    return out.getvalue()


def encode_exr(picture: AnyArray, half: bool = True, space: str = "") -> bytes:
    """Encode a picture, (h, w, 3) or (h, w, 4) with straight opacity, as an EXR with premultiplied colours, as
    compositing programs expect them; float16 if `half`, else float32.

    Args:
        space: colour space of the picture, whose values are written; "": it is sRGB-encoded and is written as linear
            light of Rec. 709.
    """
    values = as_float(picture)
    light = values[..., :3] if space else linear(values[..., :3])
    if values.shape[2] == 4:
        light = np.dstack([light * values[..., 3:], values[..., 3]])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | _colour_tags(space)
    name, out = "RGBA"[: light.shape[2]], io.BytesIO()
    with OpenEXR.File(header, {name: np.ascontiguousarray(light, np.float16 if half else np.float32)}) as file:
        file.write(out)
    return out.getvalue()


def _colour_tags(space: str) -> dict[str, Any]:
    """Attributes that name the colour space of a picture, as far as it has an interoperable name."""
    interop = interop_id(space) if space else _LINEAR_709
    if interop == _LINEAR_709:
        return {"chromaticities": _CHROMATICITIES_709, "colorInteropID": interop}
    found: dict[str, Any] = {"colorInteropID": interop} if interop else {}
    with suppress(Exception):  # an id that OpenEXR does not know
        found["chromaticities"] = tuple(map(float, np.ravel(OpenEXR.colorInteropIDToChromaticities(interop))))
    return found


EXR_FRAMES = OutputFormat(
    name="exr", title="OpenEXR frames", help="The film's frames as linear half-float pictures, in a zip",
    media_type="application/zip", suffixes=(), frame_suffixes=(".exr",), shown_as="sheet",
    profiles=(
        Profile(
            name="half", title="Half float", help="Linear Rec. 709, premultiplied opacity", depth_bits=16,
            is_float=True, has_quality=False, low_bytes_per_pixel=0.6, bytes_per_pixel=5,
            encode=lambda picture, space: encode_exr(picture, True, space),
        ),
        Profile(
            name="float", title="Single float", help="Linear Rec. 709, premultiplied opacity", depth_bits=32,
            is_float=True, has_quality=False, low_bytes_per_pixel=1, bytes_per_pixel=10,
            encode=lambda picture, space: encode_exr(picture, False, space),
        ),
    ),
)  # fmt: skip
