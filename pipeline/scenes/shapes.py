"""Scene of textured shapes with different motions, for tests and for measuring optical flow.

A disc passes behind a bar and is hidden for some frames; a star rotates, a square grows, a ring passes in front.
"""

from __future__ import annotations

import math

from pipeline.scenes import paints as p
from pipeline.scenes.base import CutOut, Motion, Paint
from pipeline.scenes.outlines import box, disc, everywhere, polygon, star, without
from pipeline.scenes.pose import Pose

SECONDS = 2.0


def cutouts(seed: int) -> list[CutOut]:
    """Cut-outs of the scene, from back to front."""
    wall = p.grainy(p.vertical("#6d8f8a", "#39545f", 0.0, 1.0), 0.35, 0.5, seed)
    return [
        CutOut("wall", everywhere, wall, lambda t: Pose.shift(-0.06 * t, 0.015 * t), line_px=0),
        CutOut(
            "disc",
            disc(0, 0, 0.095),
            _paint("#d95f4b", seed + 1),
            _line(-0.42, 0.30, 0.42, 0.02, 0.8),
            _square(0.1),
            bulge=0.09,
        ),
        CutOut(
            "bar", box(0, 0, 0.13, 0.26, 0.02), _paint("#c9b458", seed + 2), _line(0.02, 0.31, -0.03, 0.0), _square(0.3)
        ),
        CutOut("square", box(0, 0, 0.11, 0.11, 0.015), _paint("#4f7cac", seed + 3), _growing, _square(0.12)),
        CutOut(
            "star",
            star(5, 0.17, 0.075, 0.008),
            _paint("#e0a458", seed + 4),
            _line(0.46, 0.68, -0.16, -0.05, 1.6),
            _square(0.2),
            bulge=0.05,
        ),
        CutOut(
            "triangle",
            polygon((-0.09, 0.06), (0.0, -0.10), (0.09, 0.06), corner=0.01),
            _paint("#8f5d9e", seed + 5),
            _line(-0.05, 0.80, 0.18, -0.04, -1.1),
            _square(0.13),
        ),
        CutOut(
            "ring",
            without(disc(0, 0, 0.12), disc(0, 0, 0.065)),
            _paint("#e9e3d3", seed + 6),
            _line(0.62, 0.28, -0.26, 0.12, 0.5),
            _square(0.13),
            bulge=0.027,
        ),
    ]


def _square(half: float) -> tuple[float, float, float, float]:
    return -half, -half, half, half


def _paint(code: str, seed: int) -> Paint:
    return p.rimmed(p.grainy(p.flat(code), 0.35, 0.16, seed), "#ffffff", 0.012, 0.25)


def _line(x: float, y: float, vx: float, vy: float, spin: float = 0.0) -> Motion:
    """Linear motion from (x, y) at (vx, vy), picture heights per second, with rotation at `spin`, rad per second."""
    return lambda t: Pose.shift(x + vx * t, y + vy * t) @ Pose.rotate(spin * t)


def _growing(t: float) -> Pose:
    return Pose.shift(-0.42 + 0.05 * t, 0.70) @ Pose.rotate(0.3 * math.sin(2 * t)) @ Pose.scale(1 + 0.22 * t)
