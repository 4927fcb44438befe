"""A recording that was not made: what a fitted set of effects predicts for it, given those that were."""

from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis.data.campaign_data import Block, Campaign, Group
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.tire_state import shift

# Share of an axis's orders that hold nothing but the sensor's own noise.
_QUIETEST: Final = 0.1
_AXES: Final = 3


def reference_group(campaign: Campaign) -> Group:
    """Return the group with the most revolutions: another recording is imagined like it."""
    return max(campaign.groups, key=lambda group: group.revolutions)


def with_recording(campaign: Campaign, target: GroupConditions, revolutions: int) -> Campaign:
    """Return a campaign with one more group: another recording by the sensor of the reference.

    Its scatter is the reference's at another speed. Its orders are the reference's, to be replaced by predicted ones.
    """
    reference = reference_group(campaign)
    states = [group.state for group in campaign.groups if _is_same_state(group.conditions, target)]
    ratio = target.omega_radps / reference.conditions.omega_radps
    errors = reference.edge_errors_mps2
    group = replace(
        reference,
        label="imagined",
        conditions=target,
        blocks=(Block(revolutions, target, reference.blocks[0].orders_mps2),),
        state=states[0] if states else campaign.states,
        variance=_scatter(reference, ratio),
        edge_errors_mps2=None if errors is None else ratio**2 * errors,
    )
    return replace(campaign, groups=(*campaign.groups, group), states=campaign.states + (not states))


def carried(model: ClosureModel, larger: ClosureModel, vector: FloatArray) -> FloatArray:
    """Return parameters in a campaign with one more group: its contact's centre at 0, a new state the same tire's."""
    result = np.zeros(larger.layout.size)
    result[shared_places(model, larger)] = vector
    group = larger.campaign.groups[-1]
    if larger.campaign.states > model.campaign.states:
        reference = reference_group(model.campaign)
        change = shift(model.core.names, group.conditions, reference.conditions)
        result[larger.layout.state(group.state)] = model.tire(vector, model.campaign.groups.index(reference)) + change
    return result


def shared_places(model: ClosureModel, larger: ClosureModel) -> IntArray:
    """Return the places of a campaign's parameters among those of the campaign with one more group."""
    layout, places = larger.layout, np.arange(larger.layout.size)
    first_centre = layout.centre(0)
    return np.concatenate(
        [
            places[model.layout.states],
            places[first_centre : first_centre + len(model.campaign.groups)],
            places[layout.sensor],
            *(places[layout.effect(effect.name)] for effect in model.effects),
        ]
    )


def _is_same_state(first: GroupConditions, second: GroupConditions) -> bool:
    return (first.load_n, first.pressure_pa) == (second.load_n, second.pressure_pa)


def _scatter(group: Group, ratio: float) -> FloatArray:
    """Return the scatter of a recording at another speed, (3, ORDERS).

    The sensor's own is white in time, so a revolution's goes with omega; the rest is the ring's, and goes with omega^4.
    """
    variance = np.where(group.variance > 0.0, group.variance, np.nan)
    quiet = np.isfinite(variance).any(axis=1)
    sensor_variance = np.zeros((_AXES, 1))
    sensor_variance[quiet] = np.nanquantile(variance[quiet], _QUIETEST, axis=1)[:, None]
    result: FloatArray = (
        np.minimum(variance, sensor_variance) * ratio + np.maximum(variance - sensor_variance, 0.0) * ratio**4
    )
    return result
