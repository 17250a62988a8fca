"""Benchmarks of speed. Most report ratios measured within one run. `make bench` runs all of them and prints tables."""
