"""Measures of a painted video against its source: flicker, detail, structure, edge width, faces kept."""
