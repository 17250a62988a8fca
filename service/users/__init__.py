"""Who the caller is, keys, members of groups, and signing in with a browser."""
