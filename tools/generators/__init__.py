"""Signals and frames with known truth, for the benchmarks and the tests."""
