"""Client side of live sessions (docs/live.md): `LiveClient`, sources, sinks, and the loop that connects them."""
