"""Reasons of imported files, each with the template of its text."""

from gateway.core.reasons import Code, Codes


class ImportCode(Codes):
    """Reasons of imported files."""

    SCALE_UNLIKELY = Code(
        "the radial column may be in counts or volts: state their size, `scale`, in each axis (its steady value is "
        "{found_mps2:.4g m/s²}, {ratio:.3g} times the V²/R of {expected_mps2:.4g m/s²} of its revolutions)"
    )
    UNIT_UNLIKELY = Code(
        "the radial column is in {fitting}, not in {stated}: state it so (in {stated} its steady value is "
        "{found_mps2:.4g m/s²}, {ratio:.3g} times the V²/R of {expected_mps2:.4g m/s²} of a revolution of "
        "{period_s:.4g s} and a belt radius of {radius_m:.0f mm})"
    )
    RATE_CHANGES = Code(
        "the time column goes at {low_hz:.6g Hz} to {high_hz:.6g Hz}, and the recording at one rate: cut the file "
        "where the rate changes, about {at_s:.4g s} after the first row"
    )
    VALUES_REPEATED = Code(
        "{samples} samples repeat exactly, zeros or held values of a dropout: leave their cells empty, or cut the "
        "file there (axes: {axes}; runs: {runs}; the first is {first_s:.4g s} after the start)"
    )
    SIGNAL_INTERPOLATED = Code(
        "the signal was interpolated: import it at the rate at which it was measured ({share:.0%} of the samples lie "
        "on straight lines in every axis)"
    )
