"""The example notebook runs without errors and shows pictures."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import cv2
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[2] / "examples" / "library.ipynb"
PICTURES = 5


@pytest.mark.slow
def test_the_notebook_shows_pictures(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(notebook, timeout=280, kernel_name="python3", resources={"metadata": {"path": tmp_path}})
    client.execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    pngs = [base64.b64decode(output.data["image/png"]) for output in outputs if "image/png" in output.get("data", {})]
    pictures = [cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR) for png in pngs]
    assert len(pictures) == PICTURES
    for picture in pictures:
        left, right = np.hsplit(picture, 2)
        assert picture.shape == (180, 640, 3)
        assert float(np.abs(left.astype(int) - right.astype(int)).mean()) > 1
    printed = "".join(output.get("text", "") for output in outputs)
    assert "harbour.mp4 True" in printed
    assert "Did you mean 'lines'?" in printed


def test_the_notebook_is_stored_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in cells)
