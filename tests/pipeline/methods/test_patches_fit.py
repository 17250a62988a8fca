"""What is painted anew and what stays: errors are seen on calm ground, and matter where paint is wrong and outdated."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.methods.patches.ages import Sum, picture
from pipeline.methods.patches.fit import apart, patch_fits
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.masking import CALM, leniency, sharpness
from pipeline.methods.patches.params import PatchesParams

SIZE = (344, 344)
GRID = Grid.of(SIZE)
LIMIT = np.full((344, 344), 20, np.float32)
NOISE = np.random.Generator(np.random.Philox(5)).uniform(-90, 90, (344, 172, 1)).astype(np.float32)


def halves() -> Frame:
    """Calm to the left, leaves to the right."""
    frame = np.full((344, 344, 3), 150, np.float32)
    frame[:, 172:] += cv2.GaussianBlur(NOISE, (0, 0), 1)[..., None] * 2
    return np.asarray(np.clip(frame, 0, 255), np.uint8)


def rendering(made_from: Frame, paint: Frame) -> NDArray[np.float32]:
    return np.stack([made_from, paint]).astype(np.float32)


def with_spot(frame: Frame, shade: int, size: int = 10) -> Frame:
    out = frame.copy()
    out[100 : 100 + size, 60 : 60 + size] = shade
    return out


def test_less_is_let_pass_on_calm_ground() -> None:
    lenient = leniency(halves(), 1.0)
    assert abs(lenient[:, :100].max() - CALM) < 0.02 and lenient[:, 240:].min() > 0.95


def test_one_edge_is_no_hiding_place() -> None:
    frame = np.full((344, 344, 3), 60, np.uint8)
    frame[:, 172:] = 200
    assert leniency(frame, 1.0).max() < 0.85 < leniency(halves(), 1.0).max()


def test_a_pale_thing_on_pale_ground_is_painted() -> None:
    """Stripes 14 levels lighter than a wall: T = 25 alone would leave them out."""
    frame = np.full((172, 172, 3), 200, np.uint8)
    frame[40:130, 60:72] = 214
    painter = Painter.of("hertzmann", 1e9, 172, PatchesParams(jitter=0, relief=0), 0)
    shown = painter.picture(frame)[50:120].astype(float).mean(axis=(0, 2))
    assert shown[62:70].mean() - shown[20:40].mean() > 8


def test_a_small_dark_thing_is_as_dark_in_paint() -> None:
    frame = np.full((172, 172, 3), 210, np.uint8)
    frame[80:84, 60:80] = 40
    shown = Painter.of("hertzmann", 1e9, 172, PatchesParams(jitter=0), 0).picture(frame)
    assert shown[81:83, 65:75].mean() < 80


def test_paint_is_given_up_only_where_it_is_wrong_and_outdated() -> None:
    frame = halves()
    dark = with_spot(frame, 20)
    same = apart(dark, rendering(dark, frame), LIMIT, 2.0)[102:108, 62:68]
    will_do = apart(dark, rendering(frame, dark), LIMIT, 2.0)[102:108, 62:68]
    wrong = apart(dark, rendering(frame, frame), LIMIT, 2.0)[102:108, 62:68]
    assert same.max() == 0 and will_do.max() == 0 and wrong.min() > 4


def test_a_patch_gives_up_a_new_thing_with_its_rim_and_nothing_else() -> None:
    frame = halves()
    share = patch_fits(with_spot(frame, 20), rendering(frame, frame), LIMIT, GRID)
    assert share[100:110, 60:70].max() < 0.02, "all of it, its border too"
    assert share[:, 172:].min() > 0.98 and share[130:].min() > 0.98 and share[:70].min() > 0.98


def test_a_mean_of_what_did_not_hold_still_is_given_up_for_less() -> None:
    frame = halves()
    blurred = np.asarray(cv2.GaussianBlur(frame, (0, 0), 3), np.uint8)
    assert sharpness(blurred, frame, 1.0)[:, 220:].max() < 0.5 < sharpness(frame, frame, 1.0).min()
    limit = np.full((344, 344), 300, np.float32)
    kept = [patch_fits(frame, rendering(seen, blurred), limit, GRID)[:, 220:].mean() for seen in (frame, blurred)]
    assert kept[0] > 0.99 and kept[1] < 0.2


def test_what_looks_the_same_at_every_age_is_painted_the_same() -> None:
    """The mean of an age is noisier than that of all; but where it shows something else, it is its own."""
    frame = halves()
    noisy = np.clip(with_spot(frame, 20, 30).astype(int) + np.arange(3) - 1, 0, 255).astype(np.uint8)
    sums = [Sum((0, 0), seen, np.full((344, 344), count, np.float16)) for seen, count in ((noisy, 8), (frame, 40))]

    class Room:
        def empty(self) -> NDArray[np.float32]:
            return np.zeros((344, 344, 4), np.float32)

    own = picture(sums[:1], sums[1], Room(), GRID, 28)  # type: ignore[arg-type]
    np.testing.assert_array_equal(own[160:], frame[160:])
    assert np.abs(own[105:125, 65:85].astype(int) - noisy[105:125, 65:85]).max() <= 1
