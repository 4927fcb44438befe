"""Signals with a known truth, the real signal path, and statistics: what tools/bench_accuracy.py is made of."""

import os

# Processes share the cores already: one thread each, set before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
