"""Live sessions over a WebSocket: docs/live.md."""
