"""Access control: keys, scopes, rate limits, quotas, and checks of unauthenticated local access."""
