"""The client's side of a live stream (docs/live.md): `LiveClient`, sources, outputs, and what ties them together."""
