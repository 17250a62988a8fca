"""The `impasto` command: one file per command, and shared helpers."""
