"""Settings of every test run: threads of numpy, hypothesis, SIGINT of children, options for stored results."""

import os
import signal

from hypothesis import settings

# Small matrices everywhere: a thread for each product costs more than the product. Set before numpy is imported.
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# `make nightly` runs with fresh seeds and prints what repeats a failure; CI runs the same examples every time.
settings.register_profile("nightly", derandomize=False, print_blob=True)

# A parent that ignores SIGINT, as a shell does in the background, hands that on. Children need the default for Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    """Add the option that accepts changed results; see tests/golden."""
    parser.addoption("--update-golden", action="store_true", help="store changed results and print them")
    parser.addoption("--golden-numbers", action="store_true", help="compare the numbers of stored results only")
