"""The `impasto` command: a file a command, what they share beside them."""
