# SPDX-License-Identifier: GPL-3.0-or-later
"""A node class for a method. Its sockets and widgets are the inputs and parameters of the method's schema.

ComfyUI executes a node again when an input of it changes. That is right here: a service paints the same frames from
the same inputs, parameters and seed, so that the nodes need no IS_CHANGED. Presets are sent to the page with the frame
rate's widget: web/presets.js sets the parameters to them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import comfy.model_management
import comfy.utils

from impasto_client import Client

from . import pictures
from .service import Tell, connected, log, paint

FPS, SEED = "frames_per_second", "painting_seed"
"""Widgets of all methods. ComfyUI would change a widget named "seed" by itself after each run."""
LARGEST_SEED = 2**31 - 1
SENDING = 0.1
"""Share of the progress bar for sending frames; painting has the rest."""


def node_class(method: Mapping[str, Any]) -> type[Paint]:
    """A node for a method, as `GET /v1/methods` describes it."""
    return type(f"Impasto_{method['name']}", (Paint,), {"METHOD": method, "DESCRIPTION": method["summary"]})


class Paint:
    """Paints a batch of images on the service."""

    METHOD: ClassVar[Mapping[str, Any]]
    CATEGORY = "Impasto"
    FUNCTION = "paint"
    RETURN_TYPES = ("IMAGE", "MASK", "STRING")
    RETURN_NAMES = ("painted", "mask", "report")
    OUTPUT_TOOLTIPS = ("Painted frames.", "1 where they are transparent.", "The job and what the service assumed.")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, dict[str, tuple[Any, ...]]]:  # noqa: N802 (ComfyUI's name)
        needed: dict[str, tuple[Any, ...]] = {}
        optional: dict[str, tuple[Any, ...]] = {}
        for each in cls.METHOD["inputs"]:
            (needed if each["required"] else optional).update(_socket(each))
        usual = cls.METHOD["defaults"]
        chosen = {"default": usual, **{each["name"]: usual | each["params"] for each in cls.METHOD["examples"]}}
        presets = {name: {key: _shown(value) for key, value in params.items()} for name, params in chosen.items()}
        needed[FPS] = ("FLOAT", {"default": 24.0, "min": 1.0, "max": 240.0, "step": 0.001, "round": False,
                                 "tooltip": "Frame rate of the images.", "presets": presets})  # fmt: skip
        needed[SEED] = ("INT", {"default": 0, "min": 0, "max": LARGEST_SEED})
        properties = cls.METHOD["params_schema"]["properties"]
        first = next((schema.get("group") for schema in properties.values()), None)
        for name, schema in properties.items():
            optional[name] = _widget(schema, advanced=schema.get("group") != first)
        return {"required": needed, "optional": optional}

    def paint(self, **given: Any) -> tuple[Any, Any, str]:
        """Painted IMAGE, MASK and a report. Raises: ImpastoError; ComfyUI's own error when the user interrupts."""
        bar = comfy.utils.ProgressBar(100)

        def tell(share: float) -> None:
            comfy.model_management.throw_exception_if_processing_interrupted()
            bar.update_absolute(round(100 * share), 100)

        with connected() as client, tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
            result = Path(scratch) / "painted.zip"
            request = self._request(client, given, Path(scratch), lambda share: tell(SENDING * share))
            job = paint(client, request, result, lambda share: tell(SENDING + (1 - SENDING) * share))
            images, mask = pictures.read_tensors(result)
        warnings = [warning["message"] for warning in job["warnings"]]
        for warning in warnings:
            log.warning("Impasto: %s", warning)
        return images, mask, "\n".join([f"{len(images)} frames, job {job['id']}", *warnings])

    def _request(self, client: Client, given: Mapping[str, Any], scratch: Path, tell: Tell) -> dict[str, Any]:
        files = [file for each in self.METHOD["inputs"] if (file := _file(each, given, scratch))]
        sent = {}
        for index, file in enumerate(files):
            asset = client.upload(file, lambda done, total, k=index: tell((k + done / max(total, 1)) / len(files)))
            sent[file.stem] = asset["id"]
        properties = self.METHOD["params_schema"]["properties"]
        values = {name: _value(given.get(name), schema) for name, schema in properties.items()}
        params = {name: value for name, value in values.items() if value not in (None, properties[name]["default"])}
        return {
            "method": self.METHOD["name"], "inputs": sent, "params": params, "seed": given[SEED],
            "output": {"format": "png"}, "name": "ComfyUI",
        }  # fmt: skip


def _socket(given: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Sockets and widgets of an input of a method."""
    name, options = given["name"], {"tooltip": given["help"]}
    if given["kind"] == "json":
        return {name: ("STRING", {"default": "", "multiline": True, **options})}
    if given["kind"] == "images":
        numbers = "Frame numbers of these pictures, from 0, with commas between."
        return {name: ("IMAGE", options), f"{name}_frames": ("STRING", {"default": "0", "tooltip": numbers})}
    return {name: ("IMAGE", options)}


def _file(each: Mapping[str, Any], given: Mapping[str, Any], scratch: Path) -> Path | None:
    """The file of an input, whose stem is the input's name; None: the user gave none."""
    name, kind = each["name"], each["kind"]
    value = given.get(name)
    if value is None or (kind == "json" and not value.strip()):
        return None
    if kind == "json":
        return pictures.write_document(value, scratch, name)
    if kind == "images":
        return pictures.write_keys(value, given.get(f"{name}_frames", "0"), scratch, name)
    if kind == "image" or (kind == "image-or-video" and len(value) == 1):
        return pictures.write_picture(value, scratch, name)
    return pictures.write_video(value, given[FPS], scratch, name)


def _shown(value: Any) -> Any:
    """A parameter as its widget has it: a list is a text with commas."""
    return ", ".join(map(str, value)) if isinstance(value, list) else value


def _value(shown: Any, schema: Mapping[str, Any]) -> Any:
    """A parameter from its widget."""
    if schema.get("type") != "array" or shown is None:
        return shown
    return [part.strip() for part in shown.split(",") if part.strip()]


def _widget(schema: Mapping[str, Any], advanced: bool) -> tuple[Any, ...]:
    """The widget of a parameter. `advanced` ones are hidden until the user shows them."""
    unit = f" ({schema['unit']})" if schema.get("unit") else ""
    commas = " With commas between." if schema.get("type") == "array" else ""
    tooltip = f"{schema.get('description', '')}{unit}{commas}"
    options = {"default": _shown(schema["default"]), "tooltip": tooltip, "advanced": advanced}
    if "enum" in schema:
        return list(schema["enum"]), options
    limits = {short: schema[name] for short, name in (("min", "minimum"), ("max", "maximum")) if name in schema}
    if schema["type"] == "integer":
        return "INT", {**options, **limits}
    if "number" in schema["type"]:  # also of a number that may have values over time
        return "FLOAT", {**options, **limits, "step": 0.01, "round": False}
    return ("BOOLEAN" if schema["type"] == "boolean" else "STRING"), options
