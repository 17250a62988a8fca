"""Kinds of previews: each a generator of records."""
