"""Portrait of a woman in a striped jersey who turns her head and blinks, in front of drifting lights.

The head consists of flat parts at different depths. When it turns, nearer parts move farther, as on a round head.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.randomness import seeded
from pipeline.scenes import paints as p
from pipeline.scenes.base import CutOut, Motion, Paint, Spot
from pipeline.scenes.grain import grain
from pipeline.scenes.outlines import Outline, blobs, box, common, disc, ellipse, everywhere, polygon, union
from pipeline.scenes.pose import Array, Pose

SECONDS = 4.0
_EYES = (-0.085, 0.085)
_BLINKS_S = (0.9, 2.7, 3.9)
_BLINK_S = 0.30


def cutouts(seed: int) -> list[CutOut]:
    """Cut-outs of the scene, from back to front."""
    return [*_room(seed), *_hair_behind(seed), *_body(seed), *_head(seed), *_face(seed), *_hair(seed)]


def _yaw_rad(t: float) -> float:
    """Rotation of the head about its vertical axis, rad."""
    return 0.42 * math.sin(1.55 * t)


def _body_motion(t: float) -> Pose:
    return Pose.shift(0.012 * math.sin(1.2 * t), 0.006 * math.sin(2.4 * t)) @ Pose.rotate(0.012 * math.sin(1.2 * t))


def _head_motion(t: float) -> Pose:
    nod = Pose.rotate(0.05 * math.sin(1.1 * t + 0.5))
    return _body_motion(t) @ Pose.shift(0.0, 0.70) @ nod @ Pose.shift(0.0, -0.27)


def _part(x: float, y: float, depth: float, width: float = 0.5) -> Motion:
    """Motion of a part of the head at (x, y) from its centre and at `depth` towards the viewer.

    Args:
        width: how strongly the part is foreshortened when the head turns: 1 = like a flat part of the face, 0 = not.
    """

    def motion(t: float) -> Pose:
        angle = _yaw_rad(t)
        across = x * math.cos(angle) + depth * math.sin(angle)
        return _head_motion(t) @ Pose.shift(across, y) @ Pose.scale(1 - width + width * math.cos(angle), 1.0)

    return motion


def _room(seed: int) -> list[CutOut]:
    wall = p.grainy(p.blend("#27374d", "#5d6d7e", lambda s: p.ramp(0.7 * s.x + 0.5 * s.y, -0.5, 0.9)), 0.10, 0.7, seed)
    random = seeded(seed, 5)
    places = np.column_stack([random.uniform(-1.3, 1.3, 12), random.uniform(0.05, 0.95, 12)])
    return [
        CutOut("wall", everywhere, wall, lambda t: Pose.shift(-0.05 * t, 0.0), line_px=0),
        *(_light(k, float(x), float(y), float(random.uniform(0.035, 0.085))) for k, (x, y) in enumerate(places)),
    ]


def _light(number: int, x: float, y: float, radius: float) -> CutOut:
    code = ("#e8a55a", "#d9795d", "#8fb8a8", "#e9cf8c")[number % 4]
    paint = p.rimmed(p.grainy(p.flat(code), 0.10, 0.2, number), "#fff0cf", 0.012, 0.5)
    speed = -0.05 - 0.9 * radius
    bounds = (-radius, -radius, radius, radius)
    return CutOut("lights", disc(0, 0, radius), paint, lambda t: Pose.shift(x + speed * t, y), bounds, bulge=radius)


def _locks(seed: int, dark: str, light: str) -> Paint:
    """Strands of hair."""

    def share(spot: Spot) -> Array:
        return p.ramp(grain(spot.x * 4, 0.5 * spot.y, 0.5, spot.pixel, seed) + 0.4 - 1.6 * spot.y, -0.9, 1.6)

    return p.blend(dark, light, share)


def _hair_behind(seed: int) -> list[CutOut]:
    shape = union(
        ellipse(0, -0.06, 0.262, 0.275),
        polygon((-0.258, -0.06), (0.258, -0.06), (0.235, 0.27), (-0.235, 0.27), corner=0.02),
    )
    return [
        CutOut(
            "hair",
            shape,
            _locks(seed + 1, "#2a1712", "#5a3323"),
            _part(0, 0, -0.06, 0.2),
            (-0.3, -0.36, 0.3, 0.31),
            bulge=0.1,
        )
    ]


def _body(seed: int) -> list[CutOut]:
    jersey = p.blend(
        "#eee6d6", "#355c7d", lambda s: p.ramp(np.sin((s.y + 0.35 * s.x**2) * 2 * math.pi / 0.082), -0.12, 0.12)
    )
    knitted = p.shaded(p.grainy(jersey, 0.10, 0.07, seed + 2), (-1, -0.4), 0.16, 0.3)
    shoulders = blobs(
        [(0, 1.02, 0.25), (-0.24, 1.06, 0.17), (0.24, 1.06, 0.17), (-0.34, 1.2, 0.16), (0.34, 1.2, 0.16)], 0.03
    )
    neck = polygon(
        (-0.078, 0.55), (0.078, 0.55), (0.088, 0.76), (0.13, 0.82), (-0.13, 0.82), (-0.088, 0.76), corner=0.012
    )
    skin = p.grainy(p.vertical("#a9674c", "#d9976f", 0.60, 0.78), 0.04, 0.2, seed + 3)
    return [
        CutOut("neck", neck, skin, _body_motion, (-0.2, 0.5, 0.2, 0.9), bulge=0.06),
        CutOut(
            "jersey",
            common(shoulders, lambda x, y: np.hypot(x / 1.15, y - 0.735) * -1 + 0.085),
            knitted,
            _body_motion,
            (-0.62, 0.68, 0.62, 1.5),
            bulge=0.1,
        ),
    ]


def _head(seed: int) -> list[CutOut]:
    def skin(spot: Spot) -> Array:
        lit = p.mix(p.rgb("#f2bd97"), p.rgb("#c47d5c"), p.ramp(0.9 * spot.x + 0.25 * spot.y, -0.10, 0.30))
        for side in (-1, 1):
            cheek = np.exp(-(((spot.x - side * 0.115) / 0.050) ** 2) - ((spot.y - 0.075) / 0.036) ** 2)
            lit = p.mix(lit, p.rgb("#dd7a66"), 0.40 * cheek)
            socket = np.exp(-(((spot.x - side * 0.085) / 0.062) ** 2) - ((spot.y + 0.028) / 0.034) ** 2)
            lit = p.mix(lit, p.rgb("#8f5340"), 0.42 * socket)
        return lit

    face = union(
        ellipse(0, -0.02, 0.205, 0.235), blobs([(0, 0.155, 0.085), (-0.06, 0.10, 0.115), (0.06, 0.10, 0.115)], 0.02)
    )
    ear = p.shaded(p.flat("#cf8d6b"), (-1, 0), 0.15, 0.03)
    return [
        *(
            CutOut(
                "head", ellipse(0, 0, 0.028, 0.052), ear, _part(x, 0.02, -0.03), (-0.04, -0.07, 0.04, 0.07), bulge=0.02
            )
            for x in (-0.208, 0.208)
        ),
        CutOut(
            "head",
            face,
            p.grainy(skin, 0.03, 0.25, seed + 4),
            _part(0, 0, 0.0, 0.25),
            (-0.24, -0.28, 0.24, 0.27),
            bulge=0.13,
        ),
    ]


def _face(seed: int) -> list[CutOut]:
    bow = union(
        ellipse(-0.022, -0.004, 0.038, 0.011), ellipse(0.022, -0.004, 0.038, 0.011), ellipse(0, 0.007, 0.044, 0.015)
    )

    def lips(x: Array, y: Array) -> Array:
        return bow(x, y + 3.5 * x * x)  # the corners go up

    red = p.stamped(p.vertical("#c65a52", "#a53c40", -0.015, 0.02), "#6e2329", _arc(0.055, 0.012, 0.0026))
    nose = p.blend("#ebb08a", "#b8704f", lambda s: p.ramp(s.x + 0.35 * s.y, -0.012, 0.034))
    nose_shape = blobs(
        [(0, 0.036, 0.020), (-0.019, 0.040, 0.009), (0.019, 0.040, 0.009), (0, 0.01, 0.010), (0, -0.02, 0.007)], 0.008
    )
    nostrils = p.stamped(
        nose, "#6f3a2a", union(ellipse(-0.014, 0.048, 0.007, 0.0035), ellipse(0.014, 0.048, 0.007, 0.0035))
    )
    return [
        *(part for x in _EYES for part in _eye(seed, x)),
        CutOut("nose", nose_shape, nostrils, _part(0, 0.02, 0.10), (-0.05, -0.05, 0.05, 0.08), bulge=0.02, line_px=0.7),
        CutOut("mouth", lips, red, _part(0, 0.143, 0.075, 1.0), (-0.08, -0.03, 0.08, 0.04), bulge=0.01),
    ]


def _arc(width: float, sag: float, thickness: float) -> Outline:
    """Thin arc with raised ends: the line between the lips."""
    return lambda x, y: np.abs(y - sag * (0.35 - (x / width) ** 2)) - thickness + np.maximum(np.abs(x) - width, 0)


_ALMOND = common(disc(0, 0.036, 0.058), disc(0, -0.036, 0.058))
"""Outline of an open eye."""


def _eye(seed: int, x: float) -> list[CutOut]:
    def iris(spot: Spot) -> Array:
        r = np.hypot(spot.x, spot.y)
        ring = p.mix(p.rgb("#6f9a72"), p.rgb("#24402f"), p.ramp(r, 0.008, 0.021))
        rays = ring * (1 + 0.2 * grain(9 * np.arctan2(spot.y, spot.x), 20 * r, 3.0, spot.pixel * 20, seed)[..., None])
        pupil = p.mix(rays, p.rgb("#0c0a0c"), p.ramp(-r, -0.0105, -0.0085))
        return p.mix(pupil, p.rgb("#ffffff"), p.ramp(-np.hypot(spot.x + 0.006, spot.y + 0.007), -0.0055, -0.0040))

    bounds = (-0.06, -0.04, 0.06, 0.04)
    place = _part(x, -0.025, 0.075, 1.0)
    white = p.rimmed(p.vertical("#cfc8c6", "#f7f3ee", -0.02, 0.005), "#4a2a22", 0.007, 0.8)

    def gaze(t: float) -> Pose:
        return place(t) @ Pose.shift(0.010 * math.sin(1.55 * t + 0.7), -0.001)

    def crease(u: Array, v: Array) -> Array:
        return np.maximum(_ALMOND(u, v + 0.0035), -_ALMOND(u, v - 0.002))

    lash = p.flat("#22120f")
    lid = p.blend("#d29a78", "#22120f", lambda s: (s.depth < 0.006) * p.ramp(s.y, 0.0, 0.006))
    return [
        CutOut("eyes", _ALMOND, white, place, bounds, bulge=0.03),
        CutOut("eyes", common(disc(0, 0, 0.0205), lambda u, v: v - 0.0235), iris, gaze, (-0.03, -0.03, 0.03, 0.03)),
        CutOut("eyes", common(crease, lambda u, v: v + 0.002), lash, place, bounds, line_px=0),
        CutOut("eyes", _ALMOND, lid, _lid(place), bounds),
        CutOut(
            "brows",
            _brow(math.copysign(1, x)),
            p.grainy(p.flat("#3a2119"), 0.3, 0.05, seed + 5),
            _part(x, -0.083, 0.08, 1.0),
            (-0.075, -0.03, 0.075, 0.04),
        ),
    ]


def _brow(side: float) -> Outline:
    """Eyebrow, arched towards the temple, with raised inner end."""

    def outline(x: Array, y: Array) -> Array:
        middle = 1.9 * (x - side * 0.022) ** 2 + 0.10 * side * x
        half = 0.0085 * np.clip(1.2 - np.abs(x) / 0.050, 0, 1)
        return np.asarray(np.abs(y - middle) - half + np.where(half > 0, 0.0, 0.01))

    return outline


def _lid(place: Motion) -> Motion:
    """Motion of the upper lid, which is scaled to height 0 while the eye is open."""

    def motion(t: float) -> Pose:
        phase = min(abs(t - blink) for blink in _BLINKS_S) / (_BLINK_S / 2)
        shut = max(0.0, math.cos(min(phase, 1.0) * math.pi / 2))
        return place(t) @ Pose.shift(0, -0.022) @ Pose.scale(1.02, 1.04 * shut) @ Pose.shift(0, 0.022)

    return motion


def _hair(seed: int) -> list[CutOut]:
    def fringe(x: Array, y: Array) -> Array:
        cap = ellipse(0, -0.055, 0.240, 0.240)(x, y)
        parting = 0.055
        hairline = -0.120 + 1.5 * (x - parting) ** 2 + 0.055 * np.tanh((np.abs(x - parting) - 0.16) / 0.02)
        return np.asarray(np.maximum(cap, y - hairline))

    clip = p.rimmed(p.flat("#e5b13f"), "#fff0b8", 0.006, 0.8)
    return [
        CutOut(
            "hair",
            fringe,
            _locks(seed + 6, "#3c2018", "#8a5233"),
            _part(0, -0.01, 0.03, 0.2),
            (-0.26, -0.31, 0.26, 0.2),
            bulge=0.08,
        ),
        CutOut(
            "hair clip",
            box(0, 0, 0.03, 0.009, 0.009),
            clip,
            lambda t: _part(0.135, -0.175, 0.09)(t) @ Pose.rotate(0.7),
            (-0.035, -0.015, 0.035, 0.015),
            bulge=0.009,
        ),
    ]
