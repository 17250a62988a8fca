"""Brush strokes: where they go, which way they run, how they look, how they live on from frame to frame."""
