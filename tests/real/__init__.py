"""Real servers for tests, started in temporary folders and stopped with the session: PostgreSQL, and Swift for S3."""
