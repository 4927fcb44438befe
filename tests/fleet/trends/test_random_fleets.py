"""Healthy fleets of the generator of `tools` have no finding, and its planted faults have one."""

import pytest

from tools.bench_fleets import FAULTS, Fault, findings_of, fleet, is_found


@pytest.mark.parametrize("seed", [3114, 3122, 3232, 4017, 4042, 4047])
def test_cold_weeks_coarse_sensors_and_tires_filled_up_at_first_are_no_finding(seed):
    """There the contact grows in the cold, readings repeat, also on a mountain, and tires are filled up twice."""
    assert findings_of(fleet(seed)) == [[], [], [], []]


@pytest.mark.parametrize("number", [1, 2, 7, 9])
def test_planted_fault_is_found_in_its_wheel(number):
    name = list(FAULTS)[number]
    faulty, *others = findings_of(fleet(4000 + number, Fault(name, 0.6)))
    assert is_found(name, faulty)
    assert others == [[], [], []]
