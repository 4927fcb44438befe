"""Parts of tools/bench_accuracy.py: signals with known truth, the gateway's signal path, statistics and tables."""

import os

# Processes share the cores already: one thread each, set before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
