"""Small matrices everywhere: a thread for each product costs more than the product. Set before numpy is imported."""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")


def pytest_addoption(parser):
    """Add the option that accepts changed results; see tests/golden."""
    parser.addoption("--update-golden", action="store_true", help="store changed results and print them")
    parser.addoption("--golden-numbers", action="store_true", help="compare the numbers of stored results only")
