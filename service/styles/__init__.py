"""The style library: paintings to choose from."""
