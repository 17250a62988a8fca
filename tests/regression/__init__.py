"""Recorded SHA-256 values of rendered frames: a change that should not change a picture is checked against them."""
