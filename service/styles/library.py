"""The paintings of the style library: our own exemplars, and the files of a folder that the operator fills.

A painting is an asset of the library itself: decoded by guarded processes like an upload, and shown by `frame`.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from pipeline.errors import BadInput
from pipeline.video.stills import encode_png
from service.page_pictures import painted
from service.styles.exemplars import SIZE, Painting, exemplars
from workers.contract.record import Asset
from workers.errors import NotFound
from workers.farm import Farm

OWNER = "styles"
"""Owner of the library's assets, so that they count for no user's quota."""
SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff"})
MOST_FILES = 500
_CREDIT_CHARACTERS = 300
_What: TypeAlias = Literal["painting", "source"]


@dataclass(frozen=True)
class StyleOut:
    """A painting of the library."""

    id: str
    title: str
    origin: Literal["impasto", "folder"]
    """Painted by Impasto itself, or a file of the operator's folder."""
    credit: str
    """Painter and origin; empty if unknown."""
    paired: bool
    """Whether the picture from which it was painted is known."""


class StyleLibrary:
    """Thread-safe; paints one exemplar at a time.

    Args:
        folder: folder of the operator's paintings, or None.
    """

    def __init__(self, farm: Farm, folder: Path | None) -> None:
        self._farm, self._folder = farm, folder
        self._painting = threading.Lock()
        self._assets: dict[tuple[Path, int, int], str] = {}

    def listing(self) -> tuple[StyleOut, ...]:
        """Every painting: our own first, then those of the folder by name. Files are not opened."""
        own = [StyleOut(name, one.exemplar.title, "impasto", "Painted by Impasto", True)
               for name, one in exemplars().items()]  # fmt: skip
        return (*own, *(_described(path) for path in self._files()))

    def _files(self) -> Iterator[Path]:
        if self._folder is None or not self._folder.is_dir():
            return
        found = sorted(path for path in self._folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
        yield from found[:MOST_FILES]

    def painting(self, style_id: str, owner: str = OWNER) -> Asset:
        """The painting as an asset of `owner`. Raises NotFound, BadMedia (a file of the folder that is no picture)."""
        if (one := exemplars().get(style_id)) is not None:
            return self._added(self._painted(one, "painting"), f"{style_id}.png", owner)
        for path in self._files():
            if _id(path) == style_id:
                return self._added(path, path.name, owner)
        raise NotFound("Style not found.", field="style_id", value=style_id, remedy="See GET /v1/styles.")

    def source(self, style_id: str, owner: str) -> Asset | None:
        """The picture from which an exemplar was painted, as an asset; None for a file of the folder."""
        if (one := exemplars().get(style_id)) is None:
            return None
        return self._added(self._painted(one, "source"), f"{style_id}-source.png", owner)

    def picture(self, style_id: str, max_side_px: int) -> bytes:
        """The painting scaled to fit; JPEG."""
        return self._farm.assets.frame(self.painting(style_id).id, OWNER, 0, max_side_px)

    def _painted(self, one: Painting, what: _What) -> Path:
        with self._painting:
            return paint_exemplar(one, what)

    def _added(self, path: Path, filename: str, owner: str) -> Asset:
        facts = path.stat()
        key = (path, facts.st_mtime_ns, facts.st_size)
        known = self._assets.get(key)
        if known is not None:
            try:
                return self._farm.assets.get(known, owner)
            except NotFound:
                pass
        asset = self._farm.assets.add(path, filename, owner)
        if asset.kind != "image":
            raise BadInput("The file is no picture.", field="style_id", value=filename, remedy="Remove it.")
        self._assets[key] = asset.id
        return asset


def paint_exemplar(one: Painting, what: _What) -> Path:
    """The file of an exemplar, or of the picture from which it is painted; painted if it does not exist."""
    key = (one.method.name, one.exemplar, SIZE)
    return painted(f"{one.exemplar.name}-{what}.png", key, lambda: _png(one, what))


def _png(one: Painting, what: _What) -> bytes:
    return encode_png(one.painting() if what == "painting" else one.source())


def _id(path: Path) -> str:
    return f"file-{hashlib.sha256(path.name.encode()).hexdigest()[:16]}"


def _described(path: Path) -> StyleOut:
    """A file, with the first line of a text file of the same name as its credit."""
    words = path.stem.replace("_", " ").replace("-", " ").strip()
    return StyleOut(_id(path), words[:1].upper() + words[1:], "folder", _credit(path.with_suffix(".txt")), False)


def _credit(path: Path) -> str:
    if not path.is_file():
        return ""
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.readline(_CREDIT_CHARACTERS).strip()
