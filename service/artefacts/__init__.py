"""Entries of a method's artefacts, which are archives."""
