"""Signals with a known truth, the real signal path, and statistics: what tools/bench_accuracy.py is made of."""
