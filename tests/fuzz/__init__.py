"""Fuzzing: many malformed inputs, each made from a seed and a number, so that every finding can be made again."""
