# SPDX-License-Identifier: GPL-3.0-or-later
"""Impasto in ComfyUI: one node for each method of an Impasto service, made from the method's schema."""

from __future__ import annotations

from .nodes import node_class
from .service import methods

_METHODS = methods()
NODE_CLASS_MAPPINGS = {f"Impasto_{method['name']}": node_class(method) for method in _METHODS}
NODE_DISPLAY_NAME_MAPPINGS = {f"Impasto_{method['name']}": f"Impasto: {method['title']}" for method in _METHODS}
WEB_DIRECTORY = "./web"
