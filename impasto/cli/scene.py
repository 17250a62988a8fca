"""`impasto scene`."""

EPILOG = ""


def scene() -> None:
    """A procedural scene."""
