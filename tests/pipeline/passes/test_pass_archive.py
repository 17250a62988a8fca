"""Files of passes: layers, types, sizes, PNG values, and the union of several tasks' files."""

import io
import zipfile
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadFrame, BadParameter
from pipeline.formats import PASS_FORMATS
from pipeline.passes.made import FLOW, MadePass
from pipeline.passes.pass_archive import PassArchive
from workers.contract.request import OutputSpec
from workers.execution.pass_files import PassWriter, unite

IDS = MadePass("ids", "Numbers.", ("ID",), ids=True)
MATTE = MadePass("matte", "Shares.", ("Y",))
MADE = (FLOW, IDS, MATTE)
SIZE = 12, 8


def read(path: Path) -> dict[str, dict[str, NDArray[np.generic]]]:
    """Channels by name, of each image of a zip by name."""
    found = {}
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with OpenEXR.File(io.BytesIO(archive.read(name)), separate_channels=True) as file:
                found[name] = {key: channel.pixels.copy() for key, channel in file.channels().items()}
    return found


def test_an_image_has_a_layer_for_each_pass_in_its_own_type(tmp_path: Path) -> None:
    flow = np.random.default_rng(0).normal(size=(8, 12, 2)).astype(np.float32)
    numbers = (np.arange(96).reshape(8, 12) * 40_000_000).astype(np.int64)
    archive = PassArchive(tmp_path / "a", MADE, "", SIZE)
    archive.add(1001, {"ids": numbers, "flow": flow})
    archive.close()
    (channels,) = read(tmp_path / "a").values()
    assert sorted(channels) == ["flow.X", "flow.Y", "ids.ID"]
    assert channels["ids.ID"].dtype == np.uint32 and (channels["ids.ID"] == numbers).all(), "no id is rounded"
    assert (channels["flow.Y"] == flow[..., 1]).all()


def test_smaller_arrays_are_enlarged_and_numbers_are_not_mixed(tmp_path: Path) -> None:
    numbers = np.array([[1, 1000], [7, 9]])
    archive = PassArchive(tmp_path / "a", MADE, "", SIZE)
    archive.add(0, {"ids": numbers, "matte": np.array([[0, 1], [0, 1]], np.float64)})
    archive.close()
    channels = read(tmp_path / "a")["00000.exr"]
    assert (channels["ids.ID"] == np.kron(numbers, np.ones((4, 6)))).all()
    assert channels["matte.Y"].shape == (8, 12) and 0 < channels["matte.Y"][4, 5] < 0.5 < channels["matte.Y"][4, 6] < 1


def test_png_files_say_values_as_described(tmp_path: Path) -> None:
    archive = PassArchive(tmp_path / "a", MADE, PASS_FORMATS[1], SIZE)
    flow = np.full((8, 12, 2), (1.5, -600), np.float32)
    archive.add(3, {"flow": flow, "ids": np.full((8, 12), 70_000), "matte": np.full((8, 12), 0.25, np.float32)})
    archive.close()
    with zipfile.ZipFile(tmp_path / "a") as files:
        assert files.namelist() == ["flow/00003.png", "ids/00003.png", "matte/00003.png"]
        images = [cv2.imdecode(np.frombuffer(files.read(name), np.uint8), cv2.IMREAD_UNCHANGED)
                  for name in files.namelist()]  # fmt: skip
    assert images[0][0, 0].tolist() == [0, 0, 32768 + 96], "blue, green, red; 600 px are out of range"
    assert int(images[1][0, 0, 1]) * 65536 + int(images[1][0, 0, 2]) == 70_000
    assert images[2].dtype == np.uint16 and images[2][0, 0] == 16384


@pytest.mark.parametrize("array", [np.zeros((8, 12)), np.zeros((8, 12, 2), np.int64), np.zeros(5)])
def test_an_array_that_is_not_as_described_is_refused(array: NDArray[np.generic], tmp_path: Path) -> None:
    archive = PassArchive(tmp_path / "a", MADE, "", SIZE)
    with pytest.raises(BadFrame) as caught:
        archive.add(0, {"flow": array})
    assert caught.value.field == "passes.flow"


def test_files_of_several_tasks_become_one_image_a_frame(tmp_path: Path) -> None:
    spec = OutputSpec(passes=("flow", "ids", "matte"))
    rng, parts = np.random.default_rng(1), []
    wanted: dict[str, NDArray[np.generic]] = {}
    for task, (names, frames) in enumerate([(("flow",), (0, 1)), (("ids", "matte"), (0,)), (("ids", "matte"), (1,))]):
        folder = tmp_path / str(task)
        folder.mkdir()
        writer = PassWriter(MADE, spec, folder, SIZE)
        for frame in frames:
            arrays = {"flow": rng.normal(size=(8, 12, 2)), "ids": rng.integers(0, 2**32, (8, 12)),
                      "matte": rng.random((8, 12), np.float32)}  # fmt: skip
            wanted |= {f"{frame} {name}": arrays[name] for name in names}
            writer.add(frame, {name: arrays[name] for name in names})
        parts.append(writer.finish())
    assert all(parts)
    for order in ([0, 1, 2], [2, 0, 1]):
        unite([partial(nullcontext, parts[k]) for k in order], tmp_path / "whole")
        found = read(tmp_path / "whole")
        assert sorted(found) == ["00000.exr", "00001.exr"]
        for frame in (0, 1):
            channels = found[f"0000{frame}.exr"]
            assert sorted(channels) == ["flow.X", "flow.Y", "ids.ID", "matte.Y"]
            assert (channels["ids.ID"] == wanted[f"{frame} ids"]).all()
            assert (channels["flow.X"] == wanted[f"{frame} flow"][..., 0].astype(np.float32)).all()


def test_a_pass_that_was_not_asked_for_is_refused(tmp_path: Path) -> None:
    writer = PassWriter(MADE, OutputSpec(passes=("flow",)), tmp_path, SIZE)
    with pytest.raises(BadParameter):
        writer.add(0, {"matte": np.zeros((8, 12))})
    assert writer.finish() is None
