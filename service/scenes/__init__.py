"""Clips of Impasto's own scenes, for first trials."""
