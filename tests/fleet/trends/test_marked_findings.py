"""A marked finding is hidden until it grows; marks that cannot be are refused."""

import json
from dataclasses import replace

import pytest

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import CoreCode, Reason
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.marked_findings import FILE, finding_key, read_marks, set_marks, without_marked
from gateway.fleet.trends.trend_result import FleetTrends
from gateway.fleet.views.trend_page import trends_page
from tests.testkit.tire_histories import history


@pytest.fixture(scope="module")
def trends() -> FleetTrends:
    return analyse([history(5, 60, leak_pa=4000.0), history(6, 60, position="FR", sensor_id="0000b000")], recordings=60)


def key_of(trends: FleetTrends) -> str:
    (finding,) = trends.tires[0].findings
    return finding_key(trends.tires[0], finding)


def grown(trends: FleetTrends, loss_pa: float) -> FleetTrends:
    """Return the trends with a finding of another loss."""
    leaky = trends.tires[0]
    reason = Reason(FleetCode.TREND_LOSES_PRESSURE, loss_pa=loss_pa, std_pa=100.0)
    return replace(trends, tires=(replace(leaky, findings=(reason,)), *trends.tires[1:]))


@pytest.mark.parametrize("state", ["acknowledged", "closed", "put-off:2090-01-31"])
def test_marked_finding_comes_back_when_it_grows_only(tmp_path, trends, state):
    key = key_of(trends)
    set_marks(tmp_path, trends, [f"{key}={state}"])
    marks = read_marks(tmp_path)
    shown = without_marked(trends, marks)
    assert not any(tire.findings for tire in shown.tires)
    assert [note.code for note in shown.notes] == [FleetCode.TREND_FINDINGS_MARKED]
    assert key not in trends_page(shown)
    assert key in trends_page(trends)
    assert not without_marked(grown(trends, 4050.0), marks).tires[0].findings
    assert without_marked(grown(trends, 5000.0), marks).tires[0].findings
    set_marks(tmp_path, trends, [f"{key}=open"])
    assert without_marked(trends, read_marks(tmp_path)) == trends


@pytest.mark.parametrize(("count", "is_shown"), [(13, False), (60, True)])
def test_one_recording_more_is_no_new_evidence(tmp_path, trends, count, is_shown):
    def stuck(recordings: int) -> FleetTrends:
        finding = Reason(FleetCode.TREND_PRESSURE_STUCK, pressure_pa=2e5, count=recordings)
        return replace(trends, tires=(replace(trends.tires[0], findings=(finding,)),))

    marks = set_marks(tmp_path, stuck(12), [f"{key_of(stuck(12))}=closed"])
    assert bool(without_marked(stuck(count), marks).tires[0].findings) is is_shown


def test_finding_that_is_put_off_comes_back_on_its_day(tmp_path, trends):
    marks = set_marks(tmp_path, trends, [f"{key_of(trends)}=put-off:2026-05-01"])
    assert without_marked(trends, marks).tires[0].findings


@pytest.mark.parametrize("changes", [(3.0, -2.5), (6.0, 4.0)])
def test_mark_hides_all_findings_with_its_key_until_the_last_grows(tmp_path, trends, changes):
    def with_changes(*sizes: float) -> FleetTrends:
        findings = tuple(Reason(CoreCode.TREND_LEVEL_CHANGED, name="Ts", change=size, std=0.1) for size in sizes)
        return replace(trends, tires=(replace(trends.tires[0], findings=findings),))

    two = with_changes(*changes)
    marks = set_marks(tmp_path, two, [f"{finding_key(two.tires[0], two.tires[0].findings[0])}=closed"])
    shown = without_marked(two, marks)
    assert shown.tires[0].findings == ()
    assert shown.notes[-1]["count"] == 2
    grown_again = with_changes(changes[0], 2.0 * changes[1])
    assert without_marked(grown_again, marks) == grown_again


@pytest.mark.parametrize("mark", ["nothing=closed", "KEY=shut", "KEY=put-off:soon", "KEY=closed:2026-05-01", "KEY"])
def test_what_is_no_mark_is_refused_and_nothing_is_written(tmp_path, trends, mark):
    with pytest.raises(TreadlinkError) as error:
        set_marks(tmp_path, trends, [mark.replace("KEY", key_of(trends))])
    assert error.value.remedy
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize("content", ["{", "[]", "[" * 9999, json.dumps({"format": "x", "marks": {}}), '{"marks": 3}'])
def test_damaged_file_is_named(tmp_path, content):
    (tmp_path / FILE).write_text(content)
    with pytest.raises(TreadlinkError, match=FILE):
        read_marks(tmp_path)
