"""What one key can do to a service: the largest, deepest, slowest and most parallel requests of every route, and the
memory, threads and answers to others meanwhile."""
