"""Guided texture synthesis: composes a picture from pixels of a style image. See `energy`, `refine` and `sweeps`."""
