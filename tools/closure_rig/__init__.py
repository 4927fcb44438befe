"""A blind rig for the closure: tires, sensors and what nobody declares, recordings, sealed labels, a judge."""

import os

# Processes share the cores already: one thread each, set before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
