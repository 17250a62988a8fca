"""ComfyUI's table of node classes, and its loader of node packs."""

import importlib.util
import logging
import sys
from pathlib import Path

from comfy import model_management

NODE_CLASS_MAPPINGS = {}
NODE_DISPLAY_NAME_MAPPINGS = {}


def interrupt_processing(value=True):
    model_management.interrupt_current_processing(value)


def load_custom_node(module_path, ignore=frozenset(), module_parent="custom_nodes"):
    """Import a folder as a package under its name, without its parent on the path; a failing pack is only logged."""
    name = Path(module_path).name
    spec = importlib.util.spec_from_file_location(name, Path(module_path) / "__init__.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception:
        logging.exception("Cannot import %s", module_path)
        return False
    NODE_CLASS_MAPPINGS.update(module.NODE_CLASS_MAPPINGS)
    NODE_DISPLAY_NAME_MAPPINGS.update(getattr(module, "NODE_DISPLAY_NAME_MAPPINGS", {}))
    return True
