"""The endpoint for Prometheus: read by the parser of its client library, and enough for the dashboard of Grafana."""

import json
import re
import threading
from dataclasses import replace
from pathlib import Path
from urllib.request import urlopen

import pytest

from gateway.core.estimates.results import WheelState
from gateway.publishing.payloads import messages
from gateway.publishing.sink import PublishedState, SinkDownError, SinkError, SinkSetting, open_sink

parser = pytest.importorskip("prometheus_client.parser")
prometheus = pytest.importorskip("gateway.publishing.prometheus")

DASHBOARD = Path(__file__).parents[2] / "examples" / "grafana-dashboard.json"
STOP = threading.Event()


def scraped(item: PublishedState | None) -> dict[str, dict[tuple, float]]:
    """Return what the endpoint says after a state: values by metric, then wheel, link or subject, then name."""
    endpoint = prometheus.PrometheusEndpoint("127.0.0.1", 0)
    endpoint.open(STOP)
    try:
        if item is not None:
            endpoint.send(item, STOP)
        with urlopen(f"http://127.0.0.1:{endpoint.port}/metrics", timeout=20) as answer:
            text = answer.read().decode()
    finally:
        endpoint.close()
    results: dict[str, dict[tuple, float]] = {}
    for family in parser.text_string_to_metric_families(text):
        for sample in family.samples:
            results.setdefault(sample.name, {})[
                tuple(sample.labels[k] for k in sorted(sample.labels, reverse=True))
            ] = sample.value
    return results


def test_numbers_are_those_of_the_states(items) -> None:
    state = items[-1]
    result = scraped(state)
    for message in messages(state):
        if message["type"] != "wheel":
            continue
        for field in ("speed_mps", "pressure_pa", "load_n"):
            source = {"pressure_pa": ("measured",), "load_n": ("stated",)}.get(field, ())
            assert result[f"treadlink_wheel_{field}"][(message["wheel"], *source)] == message[field]
        assert result["treadlink_wheel_samples_total"][(message["wheel"],)] == message["samples"]
    assert set(result["treadlink_link_connected"].values()) == {1.0}
    first = state.snapshot.wheels[0]
    estimates = {estimate.name: estimate for estimate in first.last.estimates}
    position = (first.position, "speed_mps")
    assert result["treadlink_estimate"][position] == estimates["speed_mps"].value
    assert result["treadlink_estimate_std"][position] == estimates["speed_mps"].std
    assert result["treadlink_estimate_valid"][position] == 1.0


def test_wheel_that_stands_has_no_speed(items) -> None:
    state = items[-1]
    wheels = tuple(replace(wheel, state=WheelState.STANDSTILL) for wheel in state.snapshot.wheels)
    rolling, standing = scraped(state), scraped(replace(state, snapshot=replace(state.snapshot, wheels=wheels)))
    assert {"treadlink_wheel_speed_mps", "treadlink_wheel_rotation_rpm"} <= set(rolling) - set(standing)
    gone = {name for _, name in set(rolling["treadlink_estimate"]) - set(standing["treadlink_estimate"])}
    assert {"speed_mps", "angular_speed_radps", "turn_rate_radps"} <= gone
    assert standing["treadlink_wheel_contact_fraction"] == rolling["treadlink_wheel_contact_fraction"]


def test_invalid_estimates_are_left_out(items) -> None:
    state = items[-1]
    invalid = {
        (wheel.position, estimate.name)
        for wheel in state.snapshot.wheels
        for estimate in wheel.last.estimates
        if estimate.status == "invalid"
    }
    assert invalid
    assert not invalid & set(scraped(state)["treadlink_estimate"])


def test_nothing_is_claimed_before_the_first_state() -> None:
    assert scraped(None) == {}


def test_dashboard_asks_for_metrics_that_exist(items) -> None:
    dashboard = json.loads(DASHBOARD.read_text("utf-8"))
    asked = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", [])]
    named = {name for expression in asked for name in re.findall(r"treadlink_\w+", expression)}
    assert len(named) > 8
    # No alarm stands in these states.
    assert named - set(scraped(items[-1])) <= {"treadlink_alarm"}
    numbers = [panel["id"] for panel in dashboard["panels"]]
    assert len(set(numbers)) == len(numbers)


def test_port_in_use_is_named() -> None:
    first = prometheus.PrometheusEndpoint("127.0.0.1", 0)
    first.open(STOP)
    try:
        with pytest.raises(SinkDownError, match="cannot listen"):
            prometheus.PrometheusEndpoint("127.0.0.1", first.port).open(STOP)
    finally:
        first.close()
        first.close()


def test_wrong_option_is_refused() -> None:
    with pytest.raises(SinkError, match="no option 'x'"):
        open_sink("prometheus://127.0.0.1?x=1", SinkSetting())
