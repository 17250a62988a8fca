"""Reads a stream of preview records, as the page does."""

from __future__ import annotations

import json
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Found = tuple[dict[str, Any], bytes]


def records(data: bytes) -> list[Found]:
    """(header, payload) of each record."""
    found: list[Found] = []
    while data:
        (length,) = struct.unpack(">I", data[:4])
        header = json.loads(data[4 : 4 + length])
        found.append((header, data[4 + length : 4 + length + header["bytes"]]))
        data = data[4 + length + header["bytes"] :]
    return found


def types(found: list[Found]) -> list[str]:
    return [header["type"] for header, _ in found]


def picture(payload: bytes) -> NDArray[Any]:
    """The pixels as stored, BGR."""
    return cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_UNCHANGED)
