"""What is in deploy/ and docker/, against the real thing or its schema."""
