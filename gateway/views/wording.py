"""The text of every reason, in one table.

A template is a format string over the values of its reason. Values are in SI units; a unit after the format converts
and is printed: `{depth_m:.1f mm}` shows 0.008 as `8.0 mm`. A nested reason is replaced by its own text. `{unit: }` is
the symbol of a unit that the reason carries itself, behind a blank unless it is empty.
"""

from __future__ import annotations

import math
import string
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, Final

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.reasons import Code, Reason, Value

TEMPLATES: Final[Mapping[Code, str]] = {
    # Revolutions
    Code.CONTACT_HAS_NO_SLOPE: "the contact edges have no clear slope",
    Code.CONTACT_IN_NOISE: "the contact does not stand out of the noise",
    Code.CONTACT_INTERPOLATED: (
        "a contact was lost on the link or disturbed by an impact; it was placed between its neighbours"
    ),
    Code.NO_CONTACT: "no contact around angle 0",
    Code.RADIAL_CLIPPED: "the radial axis is clipped below the range that the hub states",
    Code.RADIAL_SATURATED: "the radial axis reached the end of its range",
    Code.SAMPLES_LOST: "samples were lost on the link",
    Code.EFFECTS_OUTSIDE_LOADS: (
        "{load_n:.0f N} is outside the {low_n:.0f N} to {high_n:.0f N} at which the effects were found"
    ),
    Code.EFFECTS_OUTSIDE_PRESSURES: (
        "{pressure_pa:.0f kPa} is outside the {low_pa:.0f kPa} to {high_pa:.0f kPa} at which the effects were found"
    ),
    Code.EFFECTS_OUTSIDE_SPEEDS: (
        "{speed_mps:.0f km/h} is outside the {low_mps:.0f km/h} to {high_mps:.0f km/h} at which the effects were found"
    ),
    Code.EFFECTS_OF_OTHER_SENSOR: "the effects were found on sensor {found_on}, but this is sensor {sensor}",
    # Estimates
    # Of any estimator
    Code.AC_COUPLED: "AC-coupled: the steady value is lost",
    Code.AVERAGE_ERRORS_UNKNOWN: "the standard errors of the average are not known",
    Code.AXIS_MISSING: "the sensor has no {axis} axis",
    Code.AXIS_NOT_FINITE: "the {axis} axis is not finite",
    Code.EDGE_ERRORS_UNKNOWN: "the standard errors of the contact edges are not known",
    Code.EFFECTS_NOT_SUBTRACTED: "known effects were not subtracted: {why}",
    Code.NEEDS_LOAD: "needs the load (set load_n of the wheel, or weight_kg of its axle, in the vehicle file)",
    Code.NEEDS_PRESSURE: (
        "needs the pressure (set pressure_kpa of the tire in the vehicle file, or use a sensor that reports it)"
    ),
    Code.NO_CONTACT_EDGES: "no contact edges were found",
    Code.NO_STEADY_VALUE: "the radial signal has no positive mean: its steady value is missing",
    Code.NOT_SETTLED: "{revolutions:.0f} revolutions so far, settles at {needed:.0f}",
    Code.REVOLUTION_NOT_USED: "this revolution was not used: {faults}",
    Code.SAMPLES_LOST_SHARE: "{share:.1%} of the samples were lost",
    Code.SPEED_OR_RADIUS_UNKNOWN: "the angular speed or the belt radius is not known",
    Code.TOO_FEW_ORDERS: "only {orders:.0f} orders, {needed:.0f} are needed: the sampling is too slow for this speed",
    # Of the tire's four numbers
    Code.BENDING_LIKE_SHEAR: "bending and shear of the belt cannot be separated here (correlation {correlation:+.2f})",
    Code.CORRELATED: "correlated {correlation:+.2f} with {number}",
    Code.FIT_AT_ZERO: "not determined: the fit puts {number} at zero",
    Code.FIT_NOT_CONVERGED: "the fit has not converged",
    Code.LINEAR_RING: "linear ring: model error is not in the standard error",
    Code.LINEAR_RING_TENSION: "linear ring: the belt's loss of tension in the contact is not in the standard error",
    Code.MODEL_ERROR_SHARE: "{share:.0%} of the variance is model error",
    Code.NO_BELT_SHAPE: "the radial signal does not describe a belt",
    Code.NO_FLAT_CONTACT: (
        "no flat contact at angle 0: its curvature is {curvature:.2f} of the mean, the limit {limit:.2f}"
    ),
    Code.NO_RING_EQUILIBRIUM: "no ring in equilibrium reproduces this waveform",
    Code.NOT_DETERMINED: "not determined: the standard error is {relative_error:.2g} times the value",
    Code.ORDERS_UNUSABLE: "the orders of the average are flat or not finite",
    Code.RING_DOES_NOT_FIT: (
        "the ring does not describe these orders: the residual is {residual:.0%} of the signal, the limit {limit:.0%}"
    ),
    # Of load and wear
    Code.BENDING_NOT_POSITIVE: "the bending stiffness is not positive",
    Code.FROM_BELT_WIDTH: "from the belt width",
    Code.FROM_CONTACT_ANGLE: "from contact angle and pressure",
    Code.FROM_RATIO: "from {ratio}, because the load is not known",
    Code.HALF_ANGLE_OUTSIDE_CALIBRATION: (
        "the contact half angle {half_angle_rad:.1f deg} is outside the calibrated {low_rad:.1f deg} to "
        "{high_rad:.1f deg}"
    ),
    Code.NEEDS_ESTIMATOR: "needs the estimator {estimator}, which made the reference numbers",
    Code.NEEDS_LOAD_CALIBRATION: "needs tire.load_calibration in the vehicle file (treadlink calibrate)",
    Code.NEEDS_REFERENCE_NUMBER: (
        "needs {number} of the new tire, tire.reference in the vehicle file (treadlink calibrate)"
    ),
    Code.NEEDS_RING_THICKNESS: "needs ring_thickness_mm of the tire in the vehicle file",
    Code.NEEDS_WEAR_VALUES: (
        "needs {revolutions:.0f} revolutions with a valid wear, of which one in {spacing:.0f} counts"
    ),
    Code.NO_LOAD_FROM_BELT_WIDTH: "not from the belt width: {why}",
    Code.NO_LOAD_FROM_CONTACT_ANGLE: "not from the contact angle: {why}",
    Code.NUMBER_MISSING: "the estimator {estimator} does not give {number}",
    Code.OVER_REVOLUTIONS: "over {revolutions:.0f} revolutions",
    Code.PRESSURE_NOT_COMPENSATED: "pressure not compensated",
    Code.PRESSURE_OUTSIDE_CALIBRATION: (
        "the pressure {pressure_pa:.0f kPa} is outside the calibrated {low_pa:.0f kPa} to {high_pa:.0f kPa}"
    ),
    Code.UNKNOWN_ESTIMATOR: "tire.reference names '{estimator}', which is not an estimator",
    Code.WORN_SINCE_CALIBRATION: "calibrated on the new tire, which is now worn by {wear_m:.1f mm}",
    # Of the lateral axis
    Code.FROM_AXIS_MEANS: "from the means of the lateral and the radial axis",
    Code.INCLUDES_CONICITY: "ply steer plus conicity",
    Code.NEEDS_BOTH_SLIPS: "needs {needed:.0f} revolutions each at left and at right slip",
    Code.ORDERS_USED: "orders {first:.0f} to {last:.0f}",
    Code.ROLL_NOT_CALIBRATED: (
        "AC-coupled: the roll tilt of the sensor cannot be calibrated; {assumed_rad:.0f deg} of it are in the error"
    ),
    Code.SCATTER_UNKNOWN: "the scatter is not known before {needed:.0f} revolutions",
    Code.SPEED_UNUSABLE: "the speed is not known or too high for the sampling",
    Code.ZERO_SLIP_GIVEN: "zero slip as given",
    Code.ZERO_SLIP_IS_MEAN: "zero slip is the mean of the latest revolutions: straight running on average is assumed",
    Code.ZERO_SLIP_NOT_SETTLED: "zero slip from {revolutions:.0f} revolutions, settles at {needed:.0f}",
    # Of the sensor's calibration
    Code.FLAT_CONTACT_ASSUMED: "AC-coupled: from the contact, assumed to be flat (flat road)",
    Code.NEEDS_TEMPERATURE_CHANGE: "needs a change of temperature",
    Code.NEEDS_TWO_SPEEDS: "needs two speeds: {quantity} and zero-g offset are not separated yet",
    Code.NO_REVOLUTION_YET: "no revolution yet",
    Code.NOT_FINITE: "the result is not finite",
    Code.OTHER_OFFSET_STATED: "the vehicle file states {stated_m:.1f mm}",
    # Of what is not locked to the wheel
    Code.AT_WHEEL_ORDER: "at order {order:.0f} of the wheel: may be locked to it",
    Code.IN_BAND: "{low_hz:.0f Hz} to {high_hz:.0f Hz}, sensor noise included",
    Code.NEEDS_UNINTERRUPTED_ROLLING: "needs {duration_s:.0f s} of uninterrupted rolling",
    Code.NO_LINE: "no line stands out",
    # Sensors
    Code.AXIS_READS: "{axis} at {counts:.0f}",
    Code.PRESSURE_FROZEN: (
        "the pressure has not changed while the temperature changed by {temperature_change_k:.0f} K; it may be "
        "off by {error_pa:.0f kPa}"
    ),
    Code.SENSOR_DEAD: "every axis reads 0: the sensor is dead or its element has no supply",
    Code.SENSOR_FLIPPED: "the radial axis points outward; its sign is corrected here",
    Code.SENSOR_LOOSE: (
        "rings at {frequency_hz:.0f Hz} behind every contact with {share:.0%} of the steady value: the sensor "
        "may have come loose; do not trust contact lengths and tire numbers"
    ),
    Code.SENSOR_STUCK: "does not move by one count for {duration_s:.0f s}: {axes} counts",
    Code.SENSOR_TILTED: (
        "the {axis} axis carries the steady value of the radial axis: tilted by {tilt_rad:.0f deg}, or the axes "
        "are swapped"
    ),
    # Wheels, links and alarms
    # Security
    # Files and configuration
    Code.RECORDING_CHANNEL_UNDECLARED: (
        "'{recording}' has messages of the undeclared channel {channel:d}, which are skipped. `treadlink repair` may "
        "recover them"
    ),
    Code.RECORDING_CHUNK_DAMAGED: (
        "'{recording}' has a damaged chunk near byte {at_byte:d}; {skipped_bytes:d} bytes are skipped. `treadlink "
        "repair` recovers what is left of them"
    ),
    Code.RECORDING_CUT_OFF: (
        "'{recording}' is cut off at byte {at_byte:d}, inside a record. `treadlink repair` completes it"
    ),
    Code.RECORDING_DESCRIPTION_DAMAGED: (
        "'{recording}' has a damaged description, which contains the vehicle configuration. `treadlink repair` "
        "recovers the rest"
    ),
    Code.RECORDING_RECORD_DAMAGED: (
        "'{recording}' has a damaged record near byte {at_byte:d}. `treadlink repair` recovers what is left of it"
    ),
    Code.RECORDING_RECORD_MISSING: (
        "'{recording}' has no valid record at byte {at_byte:d}; the rest is not read. `treadlink repair` recovers it"
    ),
    # Diagnosis: acceptance tests
    Code.IMPLAUSIBLE_PARAMETER: (
        "{parameter} would be {value:.4g}{unit: }, outside its plausible range of {low:.4g} to {high:.4g}{unit: }"
    ),
    Code.UNUSUAL_PARAMETER: (
        "{parameter} would be {value:.4g}{unit: }, which is unusual, and only one speed was recorded"
    ),
    Code.NOT_A_WHOLE_ORDER: (
        "its order would be {order:.2f} per revolution, and only whole orders repeat with the wheel"
    ),
    Code.STANDING_WAVES: (
        "its pitch of {pitch:.3g} ± {pitch_std:.2g} per revolution does not differ from 0: such waves stand still"
    ),
    Code.FADES_WITHIN_ONE_WAVE: (
        "the packet at the {edge} edge fades within {waves:.2f} of a wavelength: a bump, not a wave"
    ),
    Code.HOLLOW_ROAD: "the road would be hollow with a radius of {radius_m:.3g m}, larger than any inner drum (5 m)",
    Code.SIZE_DIFFERS_BETWEEN_RECORDINGS: "its size would have to differ between recordings (most in {recording})",
    Code.SIZE_DIFFERS_BETWEEN_AXES: "its size would have to differ between axes (most on the {axis} axis)",
    Code.ANOTHER_BELT: "it needs other belt stiffnesses than {effect}",
    Code.NO_COMMON_BELT: (
        "the belt stiffnesses common to it and {effect} would be implausible for a car tire ({stiffnesses} of "
        "typical values)"
    ),
    Code.STIFFNESS_RATIO: "{name} {ratio:.2g} times",
    Code.TOO_SMALL_BESIDE_OTHERS: "beside the other effects it is too small to be detected",
    Code.NOT_NEEDED: "held-out data are predicted equally well without it",
    Code.LEAVES_RESIDUAL: (
        "it leaves {residual_share:.0f %} of the residual where it acts, so it stands in for another cause"
    ),
    Code.LEAVES_RESIDUAL_AT_EDGES: (
        "it leaves {residual_share:.0f %} of the scatter at the contact edges, so it stands in for another cause"
    ),
    Code.SMALLER_THAN_EDGE_RESIDUAL: "it is smaller than the residual that correcting the contact edges may leave",
    Code.FOUND_IN_FEW_FOLDS: "found in only {found} of {folds} folds of the hold-out",
    Code.NOTHING_REMAINS: "nothing of it remains beside the other effects",
    Code.AXIS_HAS_OTHER_SHARE: "the {axis} axis shows {ratio:.2f} times the expected size",
    Code.AXIS_SHOULD_BE_QUIET: "the {axis} axis should not show it, but does, at {ratio:.2f} times the size",
    Code.AXIS_SHOWS_SAME_BAND: "the {axis} axis should not show this band, but does, at {ratio:.2f} times the size",
    Code.RECORDING_HAS_OTHER_SIZE: "{recording} shows {ratio:.2f} times the size expected from the other recordings",
    Code.WRONG_SPEED_EXPONENT: "it grows with speed to the power {exponent:.2f} ± {exponent_std:.2f} instead of 1",
    Code.NEEDS_AXIS_OR_SPEED: "without a circumferential axis, one speed does not distinguish it from other causes",
    Code.WRONG_QUADRATURE: (
        "the radial and circumferential axes are in quadrature to {ratio:.2f} ± {ratio_std:.2f} of the expected amount"
    ),
    Code.BELOW_SURROUNDINGS: "it does not exceed the neighbouring frequencies",
    Code.ENVELOPE_TOO_STEADY: (
        "its envelope is too steady for noise (normalized fourth moment {fourth_moment:.2f}, noise has 2)"
    ),
    Code.LEAVES_DENSITY: "it leaves {residual_share:.0f %} of the spectral density where it should be most of it",
    Code.BROADBAND_NOISE_LEFT: "broadband noise beside it is not explained by any effect",
    Code.ORDER_OR_FREQUENCY: (
        "the residual is {noise_floors:.1f} times the noise floor, and one speed does not distinguish an "
        "order from a fixed frequency"
    ),
    # Diagnosis: deciding recordings
    Code.RECORD_AT_SPEED: "record again at {speed_ratio:g} times the speed",
    Code.RECORD_REVERSED: "record again rolling in the opposite direction",
    Code.RECORD_WARMER: "record again with the tire {difference_k:g K} warmer",
    Code.RECORD_AT_LOAD: "record again at {load_ratio:g} times the load",
    Code.RECORD_AT_PRESSURE: "record again at {pressure_ratio:g} times the pressure",
    Code.RECORD_AT_REST: (
        "record at rest with the axle level and the tire lifted: the lateral axis then reads the zero-g offset alone"
    ),
    Code.RECORD_AT_ANOTHER_SPEED: "record again at another speed",
    Code.RECORD_ROAD_AT_ANOTHER_SPEED: (
        "record again at another speed: road vibration grows with it, sensor noise does not"
    ),
    Code.RECORD_LIVE: "record live, with host time stamps",
    Code.RECORD_LIVE_FOR_LONGER: "record live for longer: the hub's clock is known to {clock_std:.0f ppm} so far",
    Code.COMPARE_CLOCK: "compare the hub's clock with one better than {host_clock:.0f ppm}",
    Code.NO_RECORDING_DECIDES: "no other speed, load, pressure, temperature or direction tried here would decide",
    Code.DECIDES_AGAINST: "against {effect}: {recording}",
    # Diagnosis: notes
    Code.MEANS_NOT_COMPARED: (
        "the paper's model has no mean, so the means of the axes are not compared, and a zero-g offset or a "
        "constant gain error in them is not detected; start from --model exact to detect it"
    ),
    Code.REVOLUTIONS_LEFT_OUT: "{revolutions} revolutions left out: {reason}",
    Code.FEW_REVOLUTIONS: "only {revolutions} revolutions: a pattern common to all of them may still be chance",
    Code.ONE_SPEED: "one speed only: effects that depend on speed cannot be separated from those that do not",
    Code.STATES_NOT_DETERMINED: (
        "estimates are not determined where the held-out error exceeds {limit:g} noise floors: {states}"
    ),
    Code.STATE: "{load_n:.0f N} at {pressure_pa:.0f kPa}",
    Code.STATE_WITH_ERROR: "{load_n:.0f N} at {pressure_pa:.0f kPa} ({noise_floors:.1f})",
    Code.MORE_STATES: "{states} more",
    Code.GROUPS_TOO_SHORT: (
        "no spectrum of the signal that does not repeat with the wheel: {groups} of {of} groups are too short"
    ),
    Code.CONTACT_EDGE_JITTER: (
        "contact-edge jitter of about {rms_m:.2g mm} rms is part of the signal that does not repeat"
    ),
    Code.NOISE_ROLLS_OFF: "the noise rolls off at about {corner_hz:.0f Hz}, as behind a low-pass filter",
}

# Printed unit: factor from SI.
_UNITS: Final = {
    "%": 100.0,
    "deg": math.degrees(1.0),
    "degC": 1.0,
    "K": 1.0,
    "g": 1.0 / STANDARD_GRAVITY_MPS2,
    "GHz": 1e-9,
    "Hz": 1.0,
    "kB": 1e-3,
    "kHz": 1e-3,
    "km/h": 3.6,
    "kPa": 1e-3,
    "m": 1.0,
    "m/s²": 1.0,
    "mm": 1e3,
    "ms": 1e3,
    "ppm": 1e6,
    "N": 1.0,
    "s": 1.0,
    "us": 1e6,
}


class _Template(string.Formatter):
    """`str.format` with units of display and nested reasons."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Reason):
            return text(value)
        if isinstance(value, tuple):
            return ", ".join(self.format_field(item, format_spec) for item in value)
        if format_spec == " ":
            return f" {value}" if value else ""
        number, _, unit = format_spec.partition(" ")
        if unit:
            return f"{format(value * _UNITS[unit], number)} {unit}"
        return format(value, format_spec)


_FORMATTER: Final = _Template()


@lru_cache(maxsize=1024)
def text(reason: Reason) -> str:
    """Return a reason as a phrase without a full stop."""
    return _FORMATTER.vformat(TEMPLATES[reason.code], (), dict(reason.values))


def joined(reasons: Iterable[Reason]) -> str:
    """Return several reasons as one text, each once; empty when there are none."""
    return "; ".join(dict.fromkeys(text(reason) for reason in reasons))


def as_json(reason: Reason) -> dict[str, Any]:
    """Return a reason as JSON: code, values (SI) and text."""
    values = {name: _plain(value) for name, value in reason.values}
    return {"code": str(reason.code), "values": values, "text": text(reason)}


def fields(code: Code) -> set[str]:
    """Return the names of the values that a code's template needs."""
    return {name for _, name, _, _ in string.Formatter().parse(TEMPLATES[code]) if name}


def _plain(value: Value) -> Any:
    if isinstance(value, Reason):
        return as_json(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    # JSON has no number for what is not finite.
    return None if isinstance(value, float) and not math.isfinite(value) else value
