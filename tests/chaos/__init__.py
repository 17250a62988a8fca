"""Fault injection: a seeded schedule of faults on real components must not lose, repeat or change any work."""
