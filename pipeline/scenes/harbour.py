"""A bay at evening: sun, clouds, hills, a lighthouse, boats, gulls that cross behind a tree. The camera pans."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pipeline.randomness import seeded
from pipeline.scenes import paints as p
from pipeline.scenes.base import CutOut, Motion, Paint, Spot
from pipeline.scenes.grain import grain
from pipeline.scenes.outlines import above, blobs, box, common, disc, ellipse, everywhere, polygon, union
from pipeline.scenes.pose import Array, Pose

HORIZON = 0.56
SECONDS = 4.0


def cutouts(seed: int) -> list[CutOut]:
    """Cut-outs of the scene, from back to front."""
    return [
        *_sky(seed),
        *_land(seed),
        *_sea(seed),
        *_lighthouse(seed, _placed(_camera(0.42), 0.53, HORIZON + 0.035)),
        *_boat("far boat", seed + 50, _sailing(-0.10, 0.615, -0.035, 0.30, 1.7)),
        *_boat("boat", seed + 60, _sailing(-0.42, 0.74, 0.13, 1.0, 0.0)),
        *_gull("gull", _flight(-0.62, 0.22, 0.36, 0.075, 0.0)),
        *_gull("far gull", _flight(0.50, 0.13, -0.17, 0.045, 1.3)),
        *_shore(seed),
    ]


def _camera(parallax: float) -> Motion:
    """Slow pan to the right with a smooth start; distant objects move less (parallax)."""
    return lambda t: Pose.shift(-0.05 * parallax * (t - 0.35 * math.sin(t * 2.2) / 2.2), 0.0)


def _placed(motion: Motion, x: float, y: float) -> Motion:
    return lambda t: motion(t) @ Pose.shift(x, y)


def _sky(seed: int) -> list[CutOut]:
    still = _camera(0.04)
    glow = (0.36, 0.40)

    def sky(spot: Spot) -> Array:
        base = p.mix(p.rgb("#3f6fa8"), p.rgb("#f7d9a8"), p.ramp(spot.y, 0.0, HORIZON))
        near = np.exp(-((np.hypot(spot.x - glow[0], 1.5 * (spot.y - glow[1])) / 0.34) ** 2))
        return p.mix(base, p.rgb("#ffb46a"), 0.75 * near)

    sun = p.blend("#fff3c4", "#ffd27a", lambda s: p.ramp(np.hypot(s.x, s.y), 0.03, 0.075))
    return [
        CutOut("sky", everywhere, p.grainy(sky, 0.05, 0.9, seed, stretch=3.0), still, line_px=0),
        CutOut("sun", disc(0, 0, 0.075), sun, _placed(still, *glow), (-0.08, -0.08, 0.08, 0.08)),
        *(_cloud(seed + k, x, y, size, drift) for k, x, y, size, drift in _CLOUDS),
    ]


_CLOUDS = ((1, -0.55, 0.13, 1.0, 0.020), (2, 0.15, 0.09, 0.7, 0.012), (3, 0.66, 0.20, 1.15, 0.026))


def _cloud(seed: int, x: float, y: float, size: float, drift: float) -> CutOut:
    random = seeded(seed, 1)
    puffs = [
        (float(u), -0.055 * float(1 - (u / 0.2) ** 2) * random.uniform(0.6, 1.5), random.uniform(0.026, 0.056))
        for u in np.linspace(-0.17, 0.17, 8)
    ]
    floor = box(0, -0.018, 0.185, 0.040, 0.035)
    flat_base = common(union(blobs(puffs, 0.008), floor), lambda u, v: v - 0.022)
    paint = p.blend(
        "#fffaf0", "#e3a98c", lambda s: p.ramp(s.y + 0.02 * grain(s.x, s.y, 0.3, s.pixel, seed), -0.07, 0.045)
    )
    return CutOut(
        "clouds",
        flat_base,
        paint,
        lambda t: Pose.shift(x + drift * t, y) @ Pose.scale(size),
        (-0.26, -0.13, 0.26, 0.03),
        bulge=0.03,
    )


def _ridge(base: float, height: float, seed: int) -> Callable[[Array], Array]:
    """A skyline made of three sine waves with random phases."""
    phase = seeded(seed, 2).uniform(0, 2 * math.pi, 3)

    def level(x: Array) -> Array:
        waves = np.sin(3.1 * x + phase[0]) + 0.5 * np.sin(7.3 * x + phase[1]) + 0.22 * np.sin(17 * x + phase[2])
        return np.asarray(base - height * (0.75 + 0.45 * waves))

    return level


def _land(seed: int) -> list[CutOut]:
    far = p.grainy(p.vertical("#7d8fb3", "#c3a9a6", HORIZON - 0.2, HORIZON), 0.08, 0.5, seed + 11, 2.0)
    near = p.grainy(p.vertical("#5d7f5e", "#8fa06a", HORIZON - 0.15, HORIZON), 0.22, 0.25, seed + 12, 1.5)
    return [
        CutOut(
            "far hills",
            above(_ridge(HORIZON - 0.03, 0.085, seed + 5)),
            far,
            _camera(0.15),
            (-4.0, 0.2, 4.0, 0.66),
            bulge=0.1,
        ),
        CutOut(
            "near hills",
            above(_ridge(HORIZON + 0.012, 0.055, seed + 9)),
            near,
            _camera(0.3),
            (-4.0, 0.3, 4.0, 0.66),
            bulge=0.06,
        ),
    ]


def _lighthouse(seed: int, motion: Motion) -> list[CutOut]:
    stripes: Paint = p.blend("#f4efe4", "#c9463d", lambda s: p.ramp(np.sin(s.y * 2 * math.pi / 0.085), -0.15, 0.15))
    tower = p.shaded(p.grainy(stripes, 0.06, 0.2, seed + 20), (-1, 0), 0.22, 0.02)
    rocks = [
        (-0.13, 0.02, 0.035),
        (-0.05, 0.005, 0.055),
        (0.03, 0.012, 0.055),
        (0.11, 0.02, 0.04),
        (0.17, 0.035, 0.025),
    ]
    rock = p.grainy(p.vertical("#8d7f72", "#5a5450", -0.03, 0.05), 0.3, 0.18, seed + 21)
    house = p.stamped(
        p.flat("#efe6d3"), "#4b4a55", union(box(-0.018, -0.022, 0.007, 0.009), box(0.018, -0.022, 0.007, 0.009))
    )
    return [
        CutOut(
            "rock",
            common(blobs(rocks, 0.016), lambda x, y: y - 0.042),
            rock,
            motion,
            (-0.2, -0.06, 0.24, 0.09),
            bulge=0.04,
        ),
        CutOut(
            "house", box(-0.0, 0.0, 0.045, 0.03), house, _placed(motion, -0.075, -0.035), (-0.05, -0.04, 0.05, 0.04)
        ),
        CutOut(
            "house",
            polygon((-0.058, -0.028), (0.0, -0.075), (0.058, -0.028)),
            p.grainy(p.flat("#a4493d"), 0.12, 0.08, seed + 22, 4),
            _placed(motion, -0.075, -0.035),
            (-0.07, -0.09, 0.07, -0.02),
        ),
        CutOut(
            "lighthouse",
            polygon((-0.030, 0.0), (-0.019, -0.235), (0.019, -0.235), (0.030, 0.0)),
            tower,
            motion,
            (-0.04, -0.25, 0.04, 0.01),
            bulge=0.03,
        ),
        CutOut(
            "lighthouse",
            box(0, -0.255, 0.015, 0.022),
            p.vertical("#fff2b0", "#ffc45c", -0.28, -0.235),
            motion,
            (-0.03, -0.29, 0.03, -0.22),
        ),
        CutOut(
            "lighthouse",
            polygon((-0.026, -0.275), (0.0, -0.312), (0.026, -0.275)),
            p.flat("#8e2f2a"),
            motion,
            (-0.04, -0.33, 0.04, -0.26),
        ),
    ]


def _sea(seed: int) -> list[CutOut]:
    def water(spot: Spot) -> Array:
        base = p.mix(p.rgb("#d9a877"), p.rgb("#2c5f7c"), p.ramp(spot.y, -0.03, 0.26))
        far = 0.09 * np.log1p(np.maximum(spot.y, 0) / 0.03)  # waves look flatter towards the horizon
        waves = grain(spot.x / 7, far, 0.16, spot.pixel, seed + 30)
        ripple = grain(spot.x / 3, far, 0.10, spot.pixel, seed + 31)
        glitter = np.exp(-(((spot.x - 0.36) / (0.05 + 0.22 * spot.y)) ** 2)) * p.ramp(ripple, -0.2, 0.7)
        lit = base * (1 + 0.10 * waves[..., None])
        return p.mix(lit, p.rgb("#ffe2a6"), 0.85 * glitter)

    def tide(t: float) -> Pose:
        return _camera(0.35)(t) @ Pose.shift(0.012 * math.sin(1.1 * t), HORIZON + 0.03)

    return [CutOut("sea", lambda x, y: -y, water, tide, (-4.0, 0.0, 4.0, 1.0))]


def _sailing(x: float, y: float, speed: float, size: float, phase: float) -> Motion:
    """Motion of a boat: horizontal at `speed`, heaving and rolling, and slowly growing as it approaches."""

    def motion(t: float) -> Pose:
        bob = 0.008 * size * math.sin(1.9 * t + phase)
        roll = Pose.rotate(0.055 * math.sin(1.5 * t + phase + 0.6))
        return _camera(0.6)(t) @ Pose.shift(x + speed * t, y + bob) @ roll @ Pose.scale(size * (1 + 0.03 * t))

    return motion


def _boat(thing: str, seed: int, motion: Motion) -> list[CutOut]:
    hull = polygon((-0.15, -0.012), (0.185, -0.022), (0.135, 0.045), (-0.115, 0.045), corner=0.006)
    planks = p.grainy(p.vertical("#a8603a", "#5d3221", -0.03, 0.05), 0.16, 0.12, seed, 8.0)
    painted = p.stamped(planks, "#f2e3c4", box(0.01, -0.004, 0.3, 0.006))
    foam = p.grainy(p.flat("#9fc3cc"), 0.25, 0.1, seed + 3, 6.0)
    canvas = p.blend("#fff6e2", "#e2bd92", lambda s: p.ramp(s.x + 0.25 * s.y, -0.2, 0.02))
    jib = p.blend("#e8694c", "#b23f36", lambda s: p.ramp(s.x - 0.3 * s.y, 0.02, 0.24))
    main = p.stamped(p.grainy(canvas, 0.07, 0.16, seed + 1, 3), "#3f6f86", disc(-0.055, -0.17, 0.024))
    return [
        CutOut(thing, box(0.012, -0.21, 0.005, 0.205), p.flat("#5b3b28"), motion, (-0.01, -0.43, 0.03, 0.01)),
        CutOut(
            thing,
            polygon((0.004, -0.395), (-0.006, -0.05), (-0.150, -0.045), (-0.075, -0.21)),
            main,
            _placed(motion, 0, 0),
            (-0.17, -0.41, 0.02, -0.03),
            bulge=0.06,
        ),
        CutOut(
            thing,
            polygon((0.022, -0.375), (0.175, -0.045), (0.022, -0.055)),
            p.grainy(jib, 0.09, 0.14, seed + 2),
            motion,
            (0.0, -0.39, 0.2, -0.03),
            bulge=0.05,
        ),
        CutOut(
            thing,
            polygon((0.012, -0.425), (0.065, -0.408), (0.012, -0.392)),
            p.flat("#f0b23e"),
            motion,
            (0.0, -0.44, 0.08, -0.38),
        ),
        CutOut(thing, hull, painted, motion, (-0.18, -0.04, 0.21, 0.06), bulge=0.03),
        CutOut(thing, ellipse(0.0, 0.05, 0.17, 0.010), foam, motion, (-0.19, 0.03, 0.19, 0.07), line_px=0),
    ]


def _flight(x: float, y: float, speed: float, size: float, phase: float) -> Motion:
    def motion(t: float) -> Pose:
        facing = Pose.scale(math.copysign(size, speed), size)
        rise = 0.025 * math.sin(1.7 * t + phase)
        return (
            _camera(0.5)(t)
            @ Pose.shift(x + speed * t, y + rise)
            @ Pose.rotate(0.12 * math.cos(1.7 * t + phase))
            @ facing
        )

    return motion


def _gull(thing: str, motion: Motion) -> list[CutOut]:
    """Lengths in wing lengths; the wings beat by being squeezed about the shoulder."""
    white = p.vertical("#ffffff", "#b9c0cc", -0.15, 0.2)
    feather = p.blend("#f3f5f8", "#55606f", lambda s: p.ramp(-s.y, 0.55, 0.98))

    def wing(lag: float, lean: float) -> Motion:
        return lambda t: motion(t) @ Pose.rotate(lean) @ Pose.scale(1.0, 0.4 + 0.6 * math.sin(7.5 * t + lag))

    shape = polygon((-0.26, 0.05), (0.24, 0.05), (0.10, -0.55), (-0.16, -1.02), (-0.20, -0.5), corner=0.03)
    bounds = (-0.35, -1.1, 0.35, 0.15)
    return [
        CutOut(thing, shape, p.grainy(feather, 0.05, 0.8, 3), wing(0.0, 0.35), bounds),
        CutOut(
            thing,
            union(
                ellipse(0, 0, 0.52, 0.15),
                disc(0.48, -0.06, 0.12),
                polygon((-0.4, -0.05), (-0.85, -0.02), (-0.8, 0.1), (-0.4, 0.1)),
            ),
            white,
            motion,
            (-0.9, -0.25, 0.65, 0.25),
            bulge=0.15,
        ),
        CutOut(
            thing,
            polygon((0.58, -0.09), (0.78, -0.02), (0.57, 0.0)),
            p.flat("#f0a030"),
            motion,
            (0.5, -0.15, 0.85, 0.05),
        ),
        CutOut(thing, shape, feather, wing(0.35, -0.2), bounds),
    ]


def _shore(seed: int) -> list[CutOut]:
    def sway(x: float, y: float, amount: float, phase: float) -> Motion:
        return lambda t: _camera(1.3)(t) @ Pose.shift(x, y) @ Pose.rotate(amount * math.sin(1.3 * t + phase))

    bark = p.shaded(p.grainy(p.flat("#5e4331"), 0.35, 0.14, seed + 70), (1, 0), 0.3, 0.03)
    grass = p.grainy(p.vertical("#86a24a", "#3b5a31", 0.0, 0.22), 0.28, 0.14, seed + 71)
    trunk = polygon(
        (-0.050, 0.02), (-0.024, -0.30), (-0.034, -0.55), (0.026, -0.55), (0.022, -0.28), (0.058, 0.02), corner=0.004
    )
    bank = above(lambda x: 0.045 * np.sin(2.2 * x + 0.6) + 0.010 * np.sin(9 * x) + 0.03 * x)
    crowns = [(-0.13, -0.50, 0.16, 3.0), (0.15, -0.53, 0.15, 4.0), (0.0, -0.66, 0.19, 5.0)]
    foot = (-0.46, 0.93)
    return [
        CutOut("tree", trunk, bark, sway(*foot, 0.006, 0.0), (-0.08, -0.58, 0.08, 0.04), bulge=0.04),
        *(_crown(seed + 80 + k, sway(*foot, 0.010 + 0.003 * k, 0.3 * k), *c) for k, c in enumerate(crowns)),
        CutOut(
            "bank",
            bank,
            p.rimmed(grass, "#b9c765", 0.02, 0.7),
            _placed(_camera(1.3), 0, 0.90),
            (-4.0, -0.3, 4.0, 0.4),
            bulge=0.05,
        ),
        *_jetty(seed, _placed(_camera(1.3), 0.62, 0.90)),
        *(_flower(seed + 90 + k, sway) for k in range(9)),
    ]


def _jetty(seed: int, motion: Motion) -> list[CutOut]:
    wood = p.shaded(p.grainy(p.vertical("#8b6a4b", "#4a3527", -0.16, 0.06), 0.3, 0.10, seed + 72), (-1, 0), 0.2, 0.02)
    deck = p.grainy(p.flat("#a07c57"), 0.22, 0.16, seed + 73, 10.0)
    posts = [
        CutOut("jetty", box(x, -0.05, 0.014, 0.11, 0.004), wood, motion, (x - 0.03, -0.17, x + 0.03, 0.07))
        for x in (-0.20, 0.0, 0.20)
    ]
    return [CutOut("jetty", box(0.16, -0.075, 0.42, 0.016), deck, motion, (-0.28, -0.1, 0.6, -0.05)), *posts]


def _crown(seed: int, motion: Motion, x: float, y: float, radius: float, _phase: float) -> CutOut:
    random = seeded(seed, 3)
    angles = np.arange(11) * 2 * math.pi / 11 + random.uniform(0, 1)
    ring = [
        (x + radius * 0.62 * math.cos(a), y + radius * 0.52 * math.sin(a), radius * random.uniform(0.30, 0.44))
        for a in angles
    ]
    leaves = p.blend(
        "#9db545",
        "#2f5a35",
        lambda s: p.ramp(s.y - y - 0.6 * (s.x - x) + 0.05 * grain(s.x, s.y, 0.22, s.pixel, seed), -radius, radius),
    )
    textured = p.rimmed(p.grainy(leaves, 0.30, 0.13, seed + 1), "#c9cf62", 0.02, 0.35)
    reach = 1.25 * radius
    return CutOut(
        "tree",
        blobs([(x, y, radius * 0.62), *ring], 0.010),
        textured,
        motion,
        (x - reach, y - reach, x + reach, y + reach),
        bulge=0.06,
    )


def _flower(seed: int, sway: Callable[[float, float, float, float], Motion]) -> CutOut:
    random = seeded(seed, 4)
    x, y = random.uniform(-0.95, 0.95), random.uniform(0.945, 0.985)
    size = random.uniform(0.010, 0.017)
    petals = blobs([(size * math.cos(a), size * math.sin(a), size * 0.75) for a in np.arange(5) * 1.2566], size * 0.15)
    colour = ("#f4d35e", "#ee6c4d", "#f7f3ee")[seed % 3]
    paint = p.stamped(p.flat(colour), "#7a4a1d", disc(0, 0, size * 0.55))
    reach = 2.2 * size
    return CutOut("flowers", petals, paint, sway(x, y, 0.12, x * 9), (-reach, -reach, reach, reach))
