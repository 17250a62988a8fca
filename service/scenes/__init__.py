"""Clips of Impasto's own scenes, to try things on."""
