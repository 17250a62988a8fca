"""Scripts that draw the pictures: `python -m docs.make_gallery`, `python -m docs.make_abstraction_figures`."""
