"""The list of methods, with their parameters and thumbnails."""
