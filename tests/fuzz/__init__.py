"""Fuzzing: malformed inputs that are derived from a seed and a number, so that every finding can be reproduced."""
