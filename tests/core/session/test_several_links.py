"""Recordings of several links: alarms and comparisons of wheels are in the time of all links, as live."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

import pytest

from firmware_protocol.messages import HUB_ITSELF, HubStatus, MessageType
from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.estimates.results import AlarmRecord
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.core.recording.decoder_blocks import DecodedLinks
from gateway.core.session.alarms import AlarmName
from gateway.core.session.core import SessionCore
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from tests.core.session.hub_frames import HubFrames

S: Final = 1_000_000_000
START_NS: Final = 1_700_000_000 * S
FEW: Final = ("kinematic",)
LINKS: Final = ("a", "b")
TWO_HUBS: Final = """
[[wheel]]
position = "FL"
hub = 0
wheel = 0
[[wheel]]
position = "FR"
hub = 1
wheel = 0
[tire]
radius_mm = 320.0
"""


class Recorded:
    """Items in memory."""

    def __init__(self, items: Iterable[LinkItem]) -> None:
        self._items = list(items)
        self.position = 0

    def items(self) -> Iterator[LinkItem]:
        return iter(self._items)


def vehicle() -> VehicleConfig:
    return parse_vehicle(TWO_HUBS, "test")


def sent(number: int, *spans_s: tuple[float, float]) -> list[LinkItem]:
    """Return what a hub with one wheel sends in some spans of time, twice a second; samples do not matter here."""
    hub, items = HubFrames(number), []
    for half in (half for begin_s, end_s in spans_s for half in range(round(2 * begin_s), round(2 * end_s))):
        hub.hello(tick_us=500_000 * half, sensor_id=0xA000 + number)
        hub.environment()
        status = HubStatus(half // 2, 95 - 90 * number, 4.0, 1.0, -60, 0, 0, 0, 0)
        hub.send(MessageType.HUB_STATUS, status, wheel=HUB_ITSELF, tick_us=500_000 * half)
        # The hub of a link comes a little after that of the other.
        host_ns = START_NS + half * S // 2 + number * S // 100
        items.append(Chunk(LINKS[number], host_ns, b"".join(hub.stream)))
        hub.stream.clear()
    return items


def live(items: Iterable[LinkItem]) -> tuple[AlarmRecord, ...]:
    core, now_ns = SessionCore(vehicle(), estimators=FEW), START_NS
    for item in items:
        while now_ns + S // 10 <= item.host_ns:
            now_ns += S // 10
            core.tick(now_ns)
        core.take(item)
    core.finish()
    return core.snapshot(0.0, ended=True).alarm_records


def batch(items: Iterable[LinkItem]) -> tuple[AlarmRecord, ...]:
    recorded = RecordingPass(OpenedRecording(Recorded(items), vehicle()), FEW)
    list(recorded)
    return recorded.alarms()


def in_order(*items: LinkItem) -> list[LinkItem]:
    return sorted(items, key=lambda item: item.host_ns)


@pytest.mark.parametrize(
    ("spans_a", "spans_b", "raised_s"),
    [
        ([(0, 12)], [(0, 4), (9, 12)], [6.5]),
        ([(0, 4)], [(0, 8)], [6.5]),
        ([(0, 3)], [(8, 10), (14, 16)], [5.5, 12.5]),
        ([(0, 11)], [(0, 11)], []),
        ([(0, 4), (4.5, 8)], [(0, 4), (6, 8)], []),
    ],
)
def test_recording_has_the_alarms_of_the_session(spans_a, spans_b, raised_s) -> None:
    items = in_order(*sent(0, *spans_a), *sent(1, *spans_b))
    expected, recorded = live(items), batch(items)
    hubs = [item for item in expected if item.position.startswith("hub")]
    assert [item.first_s for item in hubs] == pytest.approx(raised_s, abs=0.1)
    assert [(item.position, item.name, item.count, item.is_standing) for item in recorded] == [
        (item.position, item.name, item.count, item.is_standing) for item in expected
    ]
    assert [item.first_s for item in recorded] == pytest.approx([item.first_s for item in expected], abs=0.1)
    totals_s = [item.total_s for item in recorded if item.position.startswith("hub")]
    assert totals_s == pytest.approx([item.total_s for item in hubs], abs=0.6), "frames come twice a second"


def test_link_that_has_ended_is_not_silent() -> None:
    ended = LinkEvent("b", START_NS + 4 * S, LinkEventKind.ENDED)
    items = in_order(*sent(0, (0, 8)), *sent(1, (0, 4)), ended)
    assert [item.position for item in batch(items)] == [item.position for item in live(items)] == ["FL", "FR"]


@pytest.mark.parametrize("is_alone", [True, False])
def test_blocks_of_a_link_are_cut_where_others_are_to_keep_up_only(is_alone) -> None:
    decoded = DecodedLinks()
    items = in_order(*sent(0, (0, 8)), *([] if is_alone else sent(1, (0, 3), (5, 8))))
    blocks = [(link, min(times), max(times)) for chunk in items for link, _, times in decoded.add(chunk)]
    blocks += [(link, min(times), max(times)) for link, _, times in decoded.finish()]
    if is_alone:
        assert blocks == [("a", START_NS, START_NS + 15 * S // 2)]
        return
    for number, (link, begin_ns, end_ns) in enumerate(blocks):
        assert end_ns - begin_ns < S
        earlier_ns = [other_end_ns for other, _, other_end_ns in blocks[:number] if other != link]
        assert max(earlier_ns, default=0) < begin_ns + S


def test_link_of_several_hubs_has_the_lowest_battery_of_those_that_send() -> None:
    limits = vehicle().thresholds.model_copy(update={"battery_min_percent": 20.0})
    core = SessionCore(vehicle().model_copy(update={"thresholds": limits}), estimators=FEW)
    for item in in_order(*sent(0, (0, 8)), *(replace(item, link="a") for item in sent(1, (0, 4)))):
        core.take(item)
        if item.host_ns == START_NS + 7 * S // 2 + S // 100:
            (link,) = core.snapshot(0.0).links
            assert (link.battery_percent, link.rssi_dbm, link.supply_w) == (5, -60, 2.0)
    assert core.snapshot(0.0).links[0].battery_percent == 95
    (battery,) = [item for item in core.snapshot(0.0).alarm_records if item.name == AlarmName.BATTERY]
    assert (battery.count, battery.is_standing) == (1, False)
