"""Fields of a method's parameters: limits, and what a form or a command line needs to show them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

Switch = Literal["on", "off"]
FlowName = Literal["dis-ultrafast", "dis-fast", "dis-medium", "tvl1"]
"""Optical flow methods, from the fastest to the most accurate: see `pipeline.flow.estimate`."""


def number(
    default: float, low: float, high: float, title: str, help_: str, unit: str, group: str, symbol: str = ""
) -> Any:
    """A number from `low` to `high`; `symbol`: its name in the paper."""
    extra: dict[str, Any] = {"unit": unit, "group": group, **({"symbol": symbol} if symbol else {})}
    return Field(default, ge=low, le=high, title=title, description=help_, json_schema_extra=extra)


def choice(default: str, title: str, help_: str, group: str) -> Any:
    """One of a few words."""
    return Field(default, title=title, description=help_, json_schema_extra={"group": group})
