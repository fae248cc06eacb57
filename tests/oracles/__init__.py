"""Truth found by brute force, for tests and benchmarks to compare with."""
