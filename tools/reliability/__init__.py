"""What `tools/bench_faults.py` runs, one fault a module; tests run the same, smaller."""
