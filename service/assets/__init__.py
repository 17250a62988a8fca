"""Assets: what users upload in one go."""
