"""Previews of one stylised frame."""
