"""Sequences of many images: cost linear in their number; archives whose entries overlap."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.errors import UnreadableMedia
from pipeline.video import shot_files
from pipeline.video.probe import probe
from pipeline.video.shot_files import is_shot, pictures_of

PNG = cv2.imencode(".png", np.zeros((32, 32, 3), np.uint8))[1].tobytes()


def _zip(path: Path, count: int) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for index in range(count):
            archive.writestr(f"shot/f{index:06d}.png", PNG)
    return path


def test_the_common_folder_is_found_once_for_all_names(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    found = shot_files.root_of
    monkeypatch.setattr(shot_files, "root_of", lambda names: calls.append(1) or found(names))
    names = [f"shot/f{index:06d}.png" for index in range(5_000)]
    assert not is_shot(names)
    assert pictures_of(names) == names
    assert len(calls) <= 2


def test_ten_thousand_images_are_probed(tmp_path: Path) -> None:
    info = probe(_zip(tmp_path / "a.zip", 10_000))
    assert (info.kind, info.frames) == ("archive", 10_000)


def test_overlapping_entries_are_rejected(tmp_path: Path) -> None:
    path = _zip(tmp_path / "a.zip", 100)
    data = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        first = archive.infolist()[0].header_offset
    at = data.find(b"PK\x01\x02")
    while at >= 0:  # every record of the central directory points to the first entry
        struct.pack_into("<I", data, at + 42, first)
        at = data.find(b"PK\x01\x02", at + 4)
    path.write_bytes(data)
    with pytest.raises(UnreadableMedia, match="overlap"):
        probe(path)
