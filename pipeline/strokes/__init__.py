"""Brush strokes: seeds, streamlines, rasterisation, layers, and stroke tracks over time."""
