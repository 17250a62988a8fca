"""Files of deploy/ and docker/, checked with the real programs or their schemas."""
