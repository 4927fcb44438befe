"""Reasons of planned sensors and uncertainty budgets, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class PlannerCode(Codes):
    """Reasons of planned sensors."""

    STATE_BETTER = Code(
        "{quantity} ±{std:.2g}{unit}: its largest part, {part:.2g}{unit}, is the {source}, stated to {stated:.2g}{of}; "
        "{how} to {better:.2g}{of}, it would be ±{improved:.2g}{unit}"
    )
    STATE_MISSING = Code(
        "{quantity} ±{std:.2g}{unit}: its largest part, {part:.2g}{unit}, is the {source}, not stated and assumed "
        "within {stated:.2g}{of}; {how} to {better:.2g}{of}, it would be ±{improved:.2g}{unit}"
    )
    LARGEST_PART = Code("{quantity} ±{std:.2g}{unit}: its largest part, {part:.2g}{unit}, is the {source}")
    PLAN_FEW_REVOLUTIONS = Code("{share:.0f} % of the simulated wheels gave no estimate")
    PLAN_MISSING = Code("its data sheet does not state {values}: state it with --sensors")
    PLAN_RANGE = Code("the range of {range_g:.0f} g is too small: the peak is {peak_g:.0f} g")
    PLAN_RATE = Code("{rate_hz:.0f} samples per second are too few: the protocol carries {least_hz:.0f} and more")
    PLAN_SURVIVAL = Code("the part may break: it survives {survival_g:.0f} g, the peak is {peak_g:.0f} g")
