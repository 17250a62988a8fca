"""Who may do what: keys, scopes, rates, quotas, and care with open loopback."""
