"""Live sessions over WebRTC: WHIP to send frames in, WHEP to watch. Needs the extra `webrtc` (aiortc)."""
