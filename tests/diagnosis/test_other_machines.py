"""The same diagnosis in other processes, whose BLAS sums in another order, as on other machines."""

import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

# Read at an angle of the belt where no effect explains it: much is left, and fits are flat.
PROGRAM = """
import json
import numpy as np
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL
from tests.diagnosis.planted_campaign import ONE_SPEED, among, campaign_of, searched, wave

kinked = wave([CIRCUMFERENTIAL, RADIAL], lambda theta: 30.0 * np.exp(-np.square((theta - 0.5) / 0.2)))
posterior, _ = searched(campaign_of(ONE_SPEED, kinked), among("mounting offset", "run-out", "structural damping"))
fit = posterior.best.fit
std = np.sqrt(np.diagonal(fit.covariance))
print(json.dumps([sorted(posterior.best.names), fit.vector.tolist(), std.tolist()]))
"""


def searched_with(**settings: str) -> tuple[list[str], list[float], list[float]]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **settings}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True)
    names, vector, std = json.loads(done.stdout)
    return names, vector, std


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="kernels of this processor have other names")
def test_sizes_do_not_depend_on_the_order_of_sums() -> None:
    names, vector, std = searched_with()
    others, other_vector, _ = searched_with(OPENBLAS_CORETYPE="Prescott")
    assert others == names
    assert np.abs((np.array(other_vector) - np.array(vector)) / np.array(std)).max() < 0.2


def test_commands_use_one_thread_whatever_the_environment_says() -> None:
    program = "import os, gateway.core.cli; print(os.environ['OPENBLAS_NUM_THREADS'])"
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1"
