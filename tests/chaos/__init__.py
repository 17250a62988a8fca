"""Faults by a seeded schedule on real parts, and what they cost: nothing."""
