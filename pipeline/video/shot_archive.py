"""A shot: rendered frames with their passes, layers, styles and painted keyframes, in folders of one archive.

    shot.json               optional: order and settings of the layers, see `ShotJson`
    frames/0001.png         the whole picture, in any image format; all other numbered files use these frame numbers
    vectors/0001.*          motion vectors, in a format with planes; optional if the frames contain them
    normals/0001.png        normals as colours, or an image with a Normal pass; optional if the frames contain them
    ids/0001.png            object number of each pixel, 8 or 16 bit, or an image with IndexOB
    lines/0001.png          black lines on white
    directions/0001.png     direction of the strokes: red = x, green = y (upwards), gray = none
    guides/NAME/0001.png    additional guide images of the scene
    keyframes/0001.png      painted frames, for some of the frame numbers
    painted/0001.png        white where the keyframe of this number is painted; needed for partly painted keyframes
    style/output.png        the painting; style/input.png: the picture it was painted from; style/NAME.png: counterpart
                            of guide NAME; style/lines.png: lines; style/directions.png: directions;
                            style/mask.png: white where the subject is
    layers/LAYER/...        any of the above for one layer, and masks/0001.png: white inside the layer's silhouette

A layer inherits missing files from the shot. `read_shot` reads file names only; `check_pictures` reads every header.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Literal, NamedTuple, NoReturn

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from pipeline.compositing import Blend
from pipeline.errors import UnreadableMedia
from pipeline.formats import has_planes
from pipeline.formats.decoding import format_of
from pipeline.video.archive import MANIFEST
from pipeline.video.numbering import frame_numbers
from pipeline.video.sequence_options import USUAL, SequenceOptions
from pipeline.video.shot_files import FRAMES, LAYERS, PASSES, SPARSE, Files, is_shot

NUMBERED = ("masks", "vectors", "normals", "ids", "lines", "directions", "keyframes", "painted")
WHOLE = ""
"""Layer name of the whole picture."""


class LayerJson(BaseModel):
    """Settings of one layer in shot.json."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str = Field(min_length=1, description="Name of its folder in layers/; any name with `ids` or `objects`.")
    ids: tuple[int, ...] = Field((), description="Object numbers of the ids pass that form the layer.")
    objects: tuple[str, ...] = Field((), description="Names of objects of the Cryptomatte that form the layer.")
    params: dict[str, JsonValue] = Field({}, description="Parameters of the method that differ for this layer.")
    guides: dict[str, float] = Field({}, description="Weights of its guides by name; 0 = not used.")
    overpaint_px: float | None = Field(
        None, ge=0, le=500, description="Reach of paint beyond the silhouette; None = as keys."
    )
    stylise: bool = Field(True, description="false = the layer's own frames are composited unchanged.")
    blend: Blend = Field("over", description="How the layer is combined with the layers behind it.")
    opacity: float = Field(1.0, ge=0, le=1, description="Opacity of the whole layer.")


class ShotJson(BaseModel):
    """The file shot.json."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    version: Literal[1] = 1
    vectors: Literal["auto", "off", "cycles", "eevee", "nuke"] | tuple[float, float, float] | None = Field(
        None,
        description="Convention of the motion vectors; or three sign factors: of the next-frame vectors, of the "
        "previous-frame vectors, and of all y components.",
    )
    background: str = Field("#ffffff", pattern="^#[0-9a-fA-F]{6}$", description="Background colour behind all layers.")
    layers: tuple[LayerJson, ...] | None = Field(
        None, description="Layers from back to front; None = in order of their names."
    )


@dataclass(frozen=True)
class LayerFiles:
    """Files of one layer: pass name -> frame index (from 0) -> path in the archive."""

    name: str
    passes: Mapping[str, Mapping[int, str]]
    guides: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    style: Mapping[str, str] = field(default_factory=dict)
    """File name without extension -> path."""
    settings: LayerJson | None = None

    @property
    def where(self) -> str:
        """Name of the layer in error messages."""
        return f"layer {self.name}" if self.name else "shot"


@dataclass(frozen=True)
class ShotLayout:
    """Contents of a shot archive: files of the whole picture, files of the layers, and shot.json."""

    whole: LayerFiles
    layers: tuple[LayerFiles, ...]
    """Layers from back to front; empty if the shot has only the whole picture."""
    settings: ShotJson

    @property
    def frames(self) -> int:
        return len(self.whole.passes[FRAMES])


def read_shot(files: Files) -> ShotLayout:
    """Determine the layout of a shot from file names and shot.json; reads no image.

    Raises:
        UnreadableMedia: a picture is missing, duplicate or unknown; the message names layer, pass and frame.
    """
    tree = _Tree(files)
    settings = _manifest(files)
    numbers = tree.numbers()
    whole = tree.layer(WHOLE, "", numbers, None)
    return ShotLayout(whole, tuple(_layers(tree, settings, numbers)), settings)


class SequenceLayout(NamedTuple):
    """The layout of a shot, and its files by the paths in it."""

    layout: ShotLayout
    files: Files


def sequence_layout(files: Files) -> SequenceLayout | None:
    """The layout of a shot; a sequence of numbered images with planes is a shot with frames only. None: the files are
    neither.

    Raises: UnreadableMedia: see `read_shot`.
    """
    if is_shot(files):
        return SequenceLayout(read_shot(files), files)
    if not all(has_planes(name) and any(c.isdigit() for c in name) for name in files):
        return None
    numbered = _NumberedFrames(files)
    return SequenceLayout(read_shot(numbered), numbered)


class _NumberedFrames(dict[str, bytes]):
    """Numbered images presented as the frames of a shot. Contents are read on access."""

    def __init__(self, files: Files) -> None:
        self._files = {f"{FRAMES}/{name.rpartition('/')[2]}": name for name in files}
        super().__init__((name, b"") for name in self._files)
        self._source = files
        self.options: SequenceOptions = getattr(files, "options", USUAL)
        held = getattr(files, "held", frozenset[str]())
        self.held = frozenset(name for name, given in self._files.items() if given in held)

    def __getitem__(self, name: str) -> bytes:
        return self._source[self._files[name]]


def _layers(tree: _Tree, settings: ShotJson, numbers: Mapping[int, int]) -> Iterable[LayerFiles]:
    folders = tree.layer_names()
    if settings.layers is None:
        for name in folders:
            yield tree.layer(name, f"{LAYERS}/{name}/", numbers, None)
        return
    listed = [layer.name for layer in settings.layers]
    for name in {n for n in listed if listed.count(n) > 1}:
        _refuse(f"Layer {name} is listed twice.", f"{MANIFEST}: layers", name, "List each layer once.")
    for name in folders:
        if name not in listed:
            _refuse(f"Layer {name} is not listed.", f"{MANIFEST}: layers", name, "List it, or remove its folder.")
    for index, layer in enumerate(settings.layers):
        if layer.name not in folders and not (layer.ids or layer.objects):
            _refuse(
                f"Layer {layer.name} has no folder.", f"{MANIFEST}: layers[{index}]", layer.name,
                f"Put its pictures in {LAYERS}/{layer.name}/, or list its ids or objects.",
            )  # fmt: skip
        yield tree.layer(layer.name, f"{LAYERS}/{layer.name}/", numbers, layer)


def _manifest(files: Files) -> ShotJson:
    if MANIFEST not in files:
        return ShotJson()
    try:
        return ShotJson.model_validate(json.loads(files[MANIFEST]))
    except ValidationError as error:
        first = error.errors()[0]
        path = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in first["loc"]).lstrip(".")
        _refuse(f"{MANIFEST} is wrong: {first['msg']}.", f"{MANIFEST}: {path}", first.get("input"), "See its schema.")
    except ValueError as error:
        _refuse(f"{MANIFEST} is not JSON: {error}.", MANIFEST, None, "Check it with a JSON validator.")


class _Tree:
    """File names of a shot, split by layer and pass."""

    def __init__(self, files: Files) -> None:
        self._paths = [PurePosixPath(name) for name in sorted(files) if name != MANIFEST]
        for path in self._paths:
            self._check(path)

    def _check(self, path: PurePosixPath) -> None:
        parts = path.parts[2:] if path.parts[0] == LAYERS else path.parts
        depth = 3 if parts[:1] == ("guides",) else 2
        if not parts or parts[0] not in (FRAMES, *PASSES) or len(parts) != depth:
            _refuse(
                "The shot contains an unknown file.", "file", path,
                f"Put pictures into these folders: {', '.join((FRAMES, *PASSES, LAYERS))}.",
            )  # fmt: skip

    def layer_names(self) -> list[str]:
        return sorted({path.parts[1] for path in self._paths if path.parts[0] == LAYERS})

    def numbers(self) -> dict[int, int]:
        """Number in the file name -> frame index, from the frames of the whole picture."""
        found = self._numbered(f"{FRAMES}/", "The shot")
        if not found:
            _refuse("The shot has no pictures.", "file", f"{FRAMES}/", "Number the rendered frames in frames/.")
        return {number: index for index, number in enumerate(sorted(found))}

    def layer(self, name: str, root: str, numbers: Mapping[int, int], settings: LayerJson | None) -> LayerFiles:
        who = f"Layer {name}" if name else "The shot"
        passes = {kind: self._pass(f"{root}{kind}/", numbers, who, kind in SPARSE) for kind in (FRAMES, *NUMBERED)}
        names = sorted({p.parent.name for p in self._paths if str(p.parent.parent) == f"{root}guides"})
        guides = {guide: self._pass(f"{root}guides/{guide}/", numbers, who, False) for guide in names}
        style = {p.stem: str(p) for p in self._paths if str(p.parent) == f"{root}style"}
        for index in passes["painted"]:
            if index not in passes["keyframes"]:
                path = passes["painted"][index]
                _refuse(f"{who} has no keyframe for the mask {path}.", path, None, "Name both by the same frame.")
        return LayerFiles(name, passes, guides, style, settings)

    def _pass(self, folder: str, numbers: Mapping[int, int], who: str, sparse: bool) -> dict[int, str]:
        found = self._numbered(folder, who)
        for number, path in found.items():
            if number not in numbers:
                _refuse(
                    f"{who} has a picture for a frame that does not exist.", path, number,
                    f"Number it as one of {FRAMES}/: {min(numbers)} to {max(numbers)}.",
                )  # fmt: skip
        missing = sorted(set(numbers) - set(found))
        if found and missing and not sparse:
            _refuse(f"{who} has no picture for frame {missing[0]}.", folder, f"{len(missing)} missing: "
                    f"{', '.join(map(str, missing[:5]))}", "Render every frame of the shot.")  # fmt: skip
        return {numbers[number]: path for number, path in sorted(found.items())}

    def _numbered(self, folder: str, who: str) -> dict[int, str]:
        paths = [str(path) for path in self._paths if f"{path.parent}/" == folder]
        found = frame_numbers(paths, folder)
        if unnumbered := next((path for path, number in found.items() if number is None), None):
            _refuse(f"{who} has a picture without a number in its name.", unnumbered, None,
                    "Number pictures by their frames.")  # fmt: skip
        return {number: path for path, number in found.items() if number is not None}


def check_pictures(files: Files, layout: ShotLayout, size: tuple[int, int]) -> None:
    """Check from the headers that every numbered file is an image of the frames' size.

    Args:
        size: (width, height) of the frames, px.

    Raises:
        UnreadableMedia: a file is not an image or has a different size; the message names the file.
    """
    for layer in (layout.whole, *layout.layers):
        for paths in (*layer.passes.values(), *layer.guides.values()):
            for path in paths.values():
                _check_picture(files, path, size)


def _check_picture(files: Files, path: str, size: tuple[int, int]) -> None:
    data = files[path]
    try:
        header = format_of(data, path).header(io.BytesIO(data))
    except UnreadableMedia as error:
        _refuse(error.message, path, error.value, error.remedy)
    if (header.width, header.height) != size:
        _refuse(
            "A picture of the shot differs in size from its frames.", path, f"{header.width}x{header.height}",
            f"Make it {size[0]}x{size[1]}.",
        )  # fmt: skip


def _refuse(message: str, where: str, value: object, remedy: str) -> NoReturn:
    raise UnreadableMedia(message, field=where, value=value, remedy=remedy)
