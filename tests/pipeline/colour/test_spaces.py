"""Colour conversions against known values and against an independent implementation."""

import cv2
import numpy as np

from pipeline.colour.spaces import hsv_to_srgb, lab_to_srgb, srgb_to_hsv, srgb_to_lab, to_8bit

CUBE = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), axis=-1).reshape(-1, 3)


def test_lab_of_known_colours() -> None:
    lab = srgb_to_lab(np.array([[1, 1, 1], [0, 0, 0], [1, 0, 0], [0, 0, 1]]))
    expected = [[100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [53.24, 80.09, 67.20], [32.30, 79.19, -107.86]]
    np.testing.assert_allclose(lab, expected, atol=0.02)


def test_lab_agrees_with_scikit_image_and_opencv() -> None:
    from skimage.color import rgb2lab

    np.testing.assert_allclose(srgb_to_lab(CUBE), rgb2lab(CUBE), atol=0.01)
    fast = cv2.cvtColor(CUBE[None].astype(np.float32), cv2.COLOR_RGB2LAB)[0]
    np.testing.assert_allclose(srgb_to_lab(CUBE), fast, atol=0.35)


def test_lab_conversion_is_invertible() -> None:
    np.testing.assert_allclose(lab_to_srgb(srgb_to_lab(CUBE)), CUBE, atol=1e-6)


def test_the_lab_of_a_colour_has_the_same_bytes_alone_and_among_others() -> None:
    colours = np.random.default_rng(1).uniform(0, 1, (500, 3))
    alone = np.concatenate([srgb_to_lab(colour[None]) for colour in colours])
    assert np.array_equal(srgb_to_lab(colours), alone)


def test_colours_out_of_gamut_are_clipped() -> None:
    rgb = lab_to_srgb([[50.0, 200.0, 0.0], [120.0, 0.0, 0.0]])
    assert rgb.min() >= 0
    assert rgb.max() <= 1


def test_hsv_of_known_colours_and_back() -> None:
    hsv = srgb_to_hsv(np.array([[1, 0, 0], [0, 0.5, 0], [0, 0, 1], [0.5, 0.5, 0.5]]))
    np.testing.assert_allclose(hsv, np.array([[0, 1, 1], [120, 1, 0.5], [240, 1, 1], [0, 0, 0.5]]), atol=1e-4)
    np.testing.assert_allclose(hsv_to_srgb(srgb_to_hsv(CUBE)), CUBE, atol=1e-5)


def test_shapes_are_kept_including_empty_ones() -> None:
    for convert in (srgb_to_lab, lab_to_srgb, srgb_to_hsv, hsv_to_srgb):
        assert convert(np.zeros((0, 3))).shape == (0, 3)
        assert convert(np.zeros((2, 5, 3))).shape == (2, 5, 3)


def test_to_8bit_rounds_and_clips() -> None:
    np.testing.assert_array_equal(to_8bit([[-0.1, 0.5, 1.2]]), [[0, 128, 255]])
