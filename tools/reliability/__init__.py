"""Fault injections run by `tools/bench_faults.py`; the tests run smaller ones."""
