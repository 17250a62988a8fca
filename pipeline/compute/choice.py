"""Device selection. Order of preference: the device that the user named, a GPU, a working CPU runtime."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.compute.probe import Found, probe
from pipeline.errors import DeviceError

_KINDS = ("gpu", "cpu", "other")
REMEDY = "Install a CPU runtime with `pip install 'impasto[cpu]'`, or your GPU driver's OpenCL; see `impasto doctor`."


@dataclass(frozen=True)
class Candidate:
    """A listed device, whether it was chosen, and the reason."""

    found: Found
    chosen: bool
    reason: str


def candidates(wanted: str = "", fresh: bool = False) -> list[Candidate]:
    """All listed devices, best first.

    Args:
        wanted: "" or "auto" (a GPU, otherwise a CPU), "gpu", "cpu", or a substring of a platform or device name.
        fresh: test the devices again and ignore cached results.
    """
    ordered = sorted(probe(fresh)[0], key=_order)
    best = next((f for f in ordered if not f.fault and _fits(f, wanted)), None)
    return [Candidate(f, f is best, _reason(f, f is best, wanted)) for f in ordered]


def choose(wanted: str = "") -> Found:
    """The best working device that matches `wanted`; raises `DeviceError` with a reason for each rejected device."""
    rows = candidates(wanted)
    for row in rows:
        if row.chosen:
            return row.found
    why = "; ".join(f"{r.found.platform}, {r.found.device}: {r.reason}" for r in rows) or probe()[1]
    raise DeviceError(f"No compute device can be used: {why}", field="device", value=wanted or "auto", remedy=REMEDY)


def report(wanted: str = "", fresh: bool = True) -> list[dict[str, object]]:
    """Human-readable table: one row per device with platform, device, kind, version, works, chosen and reason.

    If no device is listed at all, the table has one row with the reason. Never raises.
    """
    rows: list[dict[str, object]] = [
        {
            "platform": row.found.platform,
            "device": row.found.device,
            "kind": row.found.kind,
            "version": row.found.version,
            "works": not row.found.fault,
            "chosen": row.chosen,
            "reason": row.reason,
        }
        for row in candidates(wanted, fresh)
    ]
    none = {"platform": "OpenCL", "device": "", "kind": "", "version": "", "works": False, "chosen": False}
    return rows or [{**none, "reason": f"{probe()[1]} {REMEDY}"}]


def _order(found: Found) -> tuple[int, tuple[int, int]]:
    return _KINDS.index(found.kind), (-found.rank[0], -found.rank[1])


def _fits(found: Found, wanted: str) -> bool:
    asked = wanted.strip().lower()
    return asked in ("", "auto", found.kind) or asked in f"{found.platform} {found.device}".lower()


def _reason(found: Found, chosen: bool, wanted: str) -> str:
    if found.fault:
        return f"does not work: {found.fault}"
    if not _fits(found, wanted):
        return f"works, but does not match the requested device: {wanted}"
    if not chosen:
        return "works, but another one comes first"
    return f"requested: {wanted}" if wanted not in ("", "auto") else f"the best {found.kind.upper()} that works"
