"""Parts of tools/bench_forces.py: bounds, driven and braked runs with known truth, tables."""

import os

# Processes share the cores already: one thread each, set before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
