"""Blind test of the closure: random tires and sensors with undeclared effects, recordings, sealed labels, judgement."""

import os

# Processes share the cores already: one thread each, set before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
