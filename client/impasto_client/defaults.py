"""Constants of the API that clients need."""

DEFAULT_SERVER = "http://127.0.0.1:8420"
FINAL = frozenset({"succeeded", "failed", "cancelled"})
"""States of a job that has ended."""
