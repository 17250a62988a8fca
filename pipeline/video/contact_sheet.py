"""Poster and contact sheet of a finished video, as JPEG. The same video gives the same bytes."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.video.reader import VideoReader
from pipeline.video.stills import encode_jpeg

_COLUMNS, _ROWS = 4, 3
_GAP_PX = 4
SHEET_TILE_PX = 320


def fit(frame: Frame, max_side_px: int) -> Frame:
    """Scale a frame down (never up) so that its longer side is at most `max_side_px`."""
    height, width = frame.shape[:2]
    scale = max_side_px / max(width, height)
    if scale >= 1:
        return frame
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)


def poster(reader: VideoReader, max_side_px: int = 1280) -> bytes:
    """The frame at one third of the video, since the first frames are often black; JPEG."""
    return encode_jpeg(fit(_frame(reader, reader.frames // 3), max_side_px))


def sheet_frames(frames: int) -> list[int]:
    """Indices of the frames on the contact sheet of a video with `frames` frames, ascending."""
    count = min(frames, _COLUMNS * _ROWS)
    return [round((i + 0.5) * frames / count - 0.5) for i in range(count)]


def contact_sheet(reader: VideoReader, tile_px: int = SHEET_TILE_PX, known: Mapping[int, Frame] | None = None) -> bytes:
    """JPEG of at most twelve evenly spaced frames in rows of four on a dark background.

    Args:
        known: frames of the sheet by index, fitted already, which are not decoded again.
    """
    wanted, known = sheet_frames(reader.frames), known or {}
    tiles = [known[i] if i in known else fit(_frame(reader, i), tile_px) for i in wanted]
    count = len(tiles)
    height, width = tiles[0].shape[:2]
    columns = min(count, _COLUMNS)
    rows = -(-count // columns)
    sheet = np.full((rows * (height + _GAP_PX) + _GAP_PX, columns * (width + _GAP_PX) + _GAP_PX, 3), 24, np.uint8)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, columns)
        y, x = _GAP_PX + row * (height + _GAP_PX), _GAP_PX + column * (width + _GAP_PX)
        sheet[y : y + height, x : x + width] = tile
    return encode_jpeg(sheet)


def _frame(reader: VideoReader, index: int) -> Frame:
    return next(reader.read(index, index + 1))
