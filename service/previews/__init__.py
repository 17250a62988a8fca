"""One stylised frame, now."""
