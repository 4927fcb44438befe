"""Parts of tools/bench_validity.py: random tires, what is stated of them, the gateway's chain, and the judgement."""

import os

# Processes share the cores already: one thread each, set before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
