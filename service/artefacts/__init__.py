"""Entries of the archives that a method's artefacts are."""
