"""Assets: files that users upload in one request."""
