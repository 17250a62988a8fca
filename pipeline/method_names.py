"""The built-in methods by name: a row here, and a file or a folder in `pipeline/methods`.

A module of its own, so that commands can offer a method before they load any. No other module outside the folders of
the methods contains the name of one.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

BUILT_IN: Mapping[str, str] = MappingProxyType({
    "abstraction": "pipeline.methods.abstraction:Abstraction",
    "patches": "pipeline.methods.patches:Patches",
    "analogy": "pipeline.methods.analogy:Analogy",
    "multistyle": "pipeline.methods.multistyle:Multistyle",
    "steady": "pipeline.methods.steady:Steady",
})  # fmt: skip
"""Method name -> its class, named as in an entry point: a job imports only its own method, because importing all of
them takes longer than painting a small still, and methods that use other methods import the registry."""
PLATFORM: Mapping[str, str] = MappingProxyType({
    "layers": "pipeline.methods.layers:Layers", "convert": "pipeline.methods.convert:Convert",
})  # fmt: skip
"""Methods of the platform's own jobs, which are not published."""
DEFAULT = "abstraction"
"""The method of whoever names none."""
DEFAULT_FILTER = "steady"
"""The filter of painted frames in a live session of whoever names none."""
