"""Groups of revolutions under equal conditions in one recording, with their means and scatter."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from gateway.core.reasons import Reason, Value
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis.data.campaign_data import Block, Group
from gateway.diagnosis.data.condition_groups import alike, folded
from gateway.diagnosis.data.contact_edge_timing import TERMS, bent_back, compare_edges, orders_bent_back
from gateway.diagnosis.data.revolution_deviations import Deviations, deviation_rate_hz, deviations
from gateway.diagnosis.data.revolution_orders import RevolutionTable, carried_order
from gateway.diagnosis.data.revolution_scatter import settle
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode

ASSUMED_LOAD_N: Final = 4000.0
ASSUMED_PRESSURE_PA: Final = 2.2e5

WILD: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="outlier")
TOO_FEW_REVOLUTIONS: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="too_few")
CUT_OFF: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="clipped")

MOST_ALIKE: Final = 5000
"""Revolutions of one group; comparing them takes 30 kB each."""
GROUP_IS_FULL: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="group_limit", limit=MOST_ALIKE)

_DEVIATIONS_S: Final = 30.0
_DRIFT_WINDOW: Final = 9
# Order 0 is real. In the other orders cosine and sine share the power.
_ONE_COEFFICIENT: Final = np.where(np.arange(ORDERS) == 0, 1.0, 0.5)


@dataclass(frozen=True, slots=True)
class Declared:
    """Stated properties of a recording.

    Attributes:
        name: of the recording, for labels.
        recording: index in the campaign.
        radius_m: belt radius.
        offset_m: sensor below the neutral layer.
        offset_known: False where that is neither stated nor measured.
        offset_measured: True where only the recording's own samples measured it.
        gain_std: relative standard error of the gain of the sensor's axes.
        roll_rad: of the sensor.
        pitch_rad: of the sensor.
        reverse: the tire rolls the other way round.
        ac_coupled: the sensor passes no steady value.
    """

    name: str
    recording: int
    radius_m: float
    offset_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    reverse: bool = False
    ac_coupled: bool = False
    offset_known: bool = True
    offset_measured: bool = False
    gain_std: float = 0.0


def make_groups(
    table: RevolutionTable, declared: Declared, folds: int, reject: Callable[[Reason, int], None]
) -> list[Group]:
    """Return the groups of one recording with at least two revolutions; single revolutions are rejected.

    All groups have state 0 and `reference_degc` NaN. Unknown temperatures are NaN, and times are host times.

    Args:
        table: revolutions in time order.
        declared: stated properties of the recording.
        folds: blocks of a group, if it has enough revolutions.
        reject: counts rejected revolutions: reason, revolutions.
    """
    load = np.where(np.isfinite(table["load_n"]), table["load_n"], ASSUMED_LOAD_N)
    pressure = np.where(np.isfinite(table["pressure_pa"]), table["pressure_pa"], ASSUMED_PRESSURE_PA)
    groups = []
    # Smoothed over revolutions: the change between two is mostly timing error of the contacts.
    drift = table["omega_dot_radps2"] * table["period_s"] / table["omega_radps"]
    drift = median_filter(drift, _DRIFT_WINDOW, mode="nearest")
    for places in alike(table["omega_radps"], load, pressure, table["temperature_degc"], drift):
        chosen = _usable_rows(table, places, reject)
        if len(chosen) < 2:
            reject(TOO_FEW_REVOLUTIONS, len(chosen))
            continue
        if len(chosen) > MOST_ALIKE:
            reject(GROUP_IS_FULL, len(chosen) - MOST_ALIKE)
            chosen = chosen[:MOST_ALIKE]
        groups.append(_group(table, chosen, declared, folds, reject))
    return groups


def _usable_rows(table: RevolutionTable, places: IntArray, reject: Callable[[Reason, int], None]) -> IntArray:
    """Return the revolutions to use: clipped ones are included only if most are clipped."""
    is_clipped = table["cut_off"][places] > 0.0
    number = int(is_clipped.sum())
    if number == 0 or 2 * number > len(places):
        return places
    reject(CUT_OFF, number)
    return places[~is_clipped]


def _group(
    table: RevolutionTable, places: IntArray, declared: Declared, folds: int, reject: Callable[[Reason, int], None]
) -> Group:
    rate_hz = float(np.median(table["rate_hz"][places]))
    highest = carried_order(rate_hz * float(table["period_s"][places].min()))
    orders = table.orders_mps2[places].astype(np.complex128)
    orders[..., highest + 1 :] = complex(math.nan, math.nan)
    if declared.ac_coupled:
        orders[..., 0] = complex(math.nan, math.nan)
    settled = settle(orders, table["omega_radps"][places], table["omega_dot_radps2"][places])
    valid = np.flatnonzero(~settled.wild)
    half_angle_rad = float(np.nanmean(table["half_angle_rad"][places[valid]]))
    edges = compare_edges(
        orders[valid],
        index=table["index"][places[valid]].astype(np.intp),
        period_s=table["period_s"][places[valid]],
        omega_radps=table["omega_radps"][places[valid]],
        omega_dot_radps2=table["omega_dot_radps2"][places[valid]],
        half_angle_rad=half_angle_rad,
        folds=folds,
    )
    early = np.zeros((len(places), TERMS))
    edge_errors, edge_variance = None, 0.0
    as_recorded = None
    if edges.evident:
        # Jittering edges smear the mean and dominate the scatter.
        early[valid] = edges.early_rad
        corrected = orders_bent_back(orders, early, half_angle_rad)
        if edges.timing.explains:
            mean = corrected[valid].mean(axis=0)
            edge_errors = edges.errors_of_mean(mean, table["index"][places[valid]].astype(np.intp))
        else:
            # What was taken is no displacement alone, and its error has no shape of its own.
            edge_variance = _ONE_COEFFICIENT * (orders - corrected)[valid].var(axis=0)
        orders = corrected
        as_recorded = settled.orders_mps2
        settled = settle(orders, table["omega_radps"][places], table["omega_dot_radps2"][places])
        valid = np.flatnonzero(~settled.wild)
    if settled.wild.any():
        reject(WILD, int(settled.wild.sum()))
    used = places[valid]
    blocks = []
    for part in folded(len(used), folds):
        mean = settled.orders_mps2[valid[part]].mean(axis=0)
        recorded_mean = None if as_recorded is None else as_recorded[valid[part]].mean(axis=0)
        blocks.append(Block(len(used[part]), _conditions(table, used[part], declared), mean, recorded_mean))
    conditions = _conditions(table, used, declared)
    deviation, deviation_hz = _deviations(table, used, settled.shift_rad[valid], early[valid], half_angle_rad, rate_hz)
    return Group(
        label=label(declared.name, conditions),
        recording=declared.recording,
        state=0,
        conditions=conditions,
        blocks=tuple(blocks),
        variance=settled.variance + edge_variance,
        half_angle_rad=half_angle_rad,
        scatter_profile=settled.profile,
        load_known=bool(np.isfinite(table["load_n"][used]).all()),
        pressure_known=bool(np.isfinite(table["pressure_pa"][used]).all()),
        declared_offset_m=declared.offset_m,
        declared_roll_rad=declared.roll_rad,
        # Along the rolling direction, the pitch of a sensor that moves backwards has the opposite sign.
        declared_pitch_rad=-declared.pitch_rad if declared.reverse else declared.pitch_rad,
        deviations_mps2=deviation.runs,
        deviation_rate_hz=deviation_hz,
        edges=edges.timing,
        edge_errors_mps2=edge_errors,
        by_angle=deviation.by_angle,
    )


def label(name: str, conditions: GroupConditions) -> Reason:
    """Return the label of a group: recording, speed, load and pressure."""
    degc = conditions.temperature_degc
    # No NaN: once it has come from another process it differs from itself.
    temperature: dict[str, Value] = {"temperature_degc": degc} if math.isfinite(degc) else {}
    return Reason(
        DiagnosisCode.GROUP_LABEL,
        recording=name,
        speed_mps=conditions.omega_radps * conditions.radius_m,
        load_n=conditions.load_n,
        pressure_pa=conditions.pressure_pa,
        **temperature,
        temperature="known" if temperature else "unknown",
        way="reverse" if conditions.reverse else "forward",
    )


def _conditions(table: RevolutionTable, places: IntArray, declared: Declared) -> GroupConditions:
    def mean(name: str, otherwise: float = math.nan) -> float:
        values = table[name][places]
        finite = values[np.isfinite(values)]
        return float(finite.mean()) if len(finite) else otherwise

    return GroupConditions(
        omega_radps=math.sqrt(float(np.square(table["omega_radps"][places]).mean())),
        omega_dot_radps2=mean("omega_dot_radps2"),
        radius_m=declared.radius_m,
        load_n=mean("load_n", ASSUMED_LOAD_N),
        pressure_pa=mean("pressure_pa", ASSUMED_PRESSURE_PA),
        temperature_degc=mean("temperature_degc"),
        reference_degc=math.nan,
        rate_hz=mean("rate_hz"),
        time_s=mean("host_s"),
        reverse=declared.reverse,
        ac_coupled=declared.ac_coupled,
        offset_known=declared.offset_known,
        offset_measured=declared.offset_measured,
        gain_std=declared.gain_std,
    )


def _deviations(
    table: RevolutionTable,
    places: IntArray,
    shift_rad: FloatArray,
    early_rad: FloatArray,
    half_angle_rad: float,
    rate_hz: float,
) -> tuple[Deviations, float]:
    chosen, duration_s = [], 0.0
    for row, index in enumerate(places.tolist()):
        if index in table.waveforms_mps2 and duration_s < _DEVIATIONS_S:
            chosen.append(row)
            duration_s += float(table["period_s"][index])
    if len(chosen) < 2:
        return Deviations(), 0.0
    rows = places[chosen]
    period_s = table["period_s"][rows]
    deviation_hz = deviation_rate_hz(rate_hz, GRID_SIZE / float(period_s.max()))
    waveforms = np.stack([table.waveforms_mps2[index] for index in rows.tolist()]).astype(np.float64)
    deviation = deviations(
        bent_back(waveforms, angle_grid(waveforms.shape[-1]), early_rad[chosen], half_angle_rad).astype(np.float32),
        index=table["index"][rows].astype(np.intp),
        shift_rad=shift_rad[chosen],
        period_s=period_s,
        omega_radps=table["omega_radps"][rows],
        omega_dot_radps2=table["omega_dot_radps2"][rows],
        rate_hz=deviation_hz,
        clipped=bool((table["cut_off"][rows] > 0.0).any()),
    )
    return deviation, deviation_hz if deviation.runs else 0.0
