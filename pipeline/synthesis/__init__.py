"""Guided texture synthesis: a picture made of another one's pixels. See `goal`, `engine`, `sweeps`."""
