"""A short test day is played, and the accounts of a day tell what is lost, missed and falsely named."""

from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.decoder import FrameDecoder
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.weighted_mean import WeightedMean
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.alarms import AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.core.wheels.wheels import Pipeline
from gateway.simulator.link_faults import frame_pieces, parse_fault
from tests.core.recording.streams import frames

pytest.importorskip("tty", reason="pseudo-terminals exist on POSIX only")
can = pytest.importorskip("can")

from tools.rehearsal.accounts import account  # noqa: E402 - needs both
from tools.rehearsal.day import START_NS, STEP_NS, Played, day_vehicle, hub_chunks  # noqa: E402
from tools.rehearsal.plan import BUS, HUBS, NOBODY, POSITIONS, RECEIVER, Fault, Kind, planned_day  # noqa: E402
from tools.rehearse import quiet_day, rehearse  # noqa: E402

LINKS = [*(f"serial:hub{hub}" for hub in range(HUBS)), "can:bus", "nmea:receiver"]
CUT = Fault(Kind.CUT, 2.0, 4.0, 2)


@pytest.mark.parametrize("rounds", [1, 2])
def test_a_day_has_every_fault_and_a_seed_its_day(rounds: int) -> None:
    faults, day_s = planned_day(7, rounds)
    assert planned_day(7, rounds) == (faults, day_s)
    assert planned_day(8, rounds)[0] != faults
    assert [sum(fault.kind is kind for fault in faults) for kind in Kind] == [
        1 if kind is Kind.REPLACED else rounds for kind in Kind
    ]
    assert all(before.end_s < after.begin_s for before, after in zip(faults, faults[1:], strict=False))
    assert faults[-1].end_s < day_s


@pytest.fixture
def played(tmp_path: Path) -> Played:
    """Return a day of hub 2, whose frames of the third second are in no recording."""
    sent = [(number * 0.1, frame) for number, frame in enumerate(frames(np.random.default_rng(1), 60, hub=2))]
    path = tmp_path / "day.mcap"
    writer = RecordingWriter(path, start_ns=START_NS)
    for at_s, frame in sent:
        if not 2.5 <= at_s < 3.5:
            writer.write(Chunk(LINKS[2], START_NS + round(at_s * 1e9), frame))
    writer.close()
    every = [[], [], sent, [], [], []]
    return Played(every, recordings=[path], links=LINKS, restored_s={link: [] for link in LINKS})


def test_what_is_lost_has_a_cause_or_is_told(played: Played) -> None:
    played.said = [(2.1, LINKS[2], str(AlarmName.LINK))]
    accounts = account(played, played, [CUT])
    assert (accounts.frames, dict(accounts.lost), accounts.unaccounted) == (60, {Kind.CUT: 10}, [])
    assert (accounts.named, accounts.missed, accounts.false) == (1, [], [])
    elsewhere = account(played, played, [CUT._replace(target=3)])
    assert len(elsewhere.unaccounted) == 10
    assert elsewhere.missed == [CUT._replace(target=3)]
    assert elsewhere.false == played.said
    assert len(account(played, played, [CUT._replace(kind=Kind.SENSOR)]).unaccounted) == 10, "a sensor loses no frame"


def test_a_name_is_of_its_fault_and_its_time(played: Played) -> None:
    pause = Fault(Kind.PAUSE, 10.0, 13.0, NOBODY)
    blamed = (13.0, "hub 2", str(AlarmName.SILENT))
    late = (30.0, "", str(LinkCode.COMPUTER_PAUSED))
    played.said = [blamed, late]
    accounts = account(played, played, [pause])
    assert accounts.missed == [pause]
    assert accounts.false == [blamed, late]
    played.said = [
        (12.0, "", str(LinkCode.COMPUTER_PAUSED)),
        *((5.0, LINKS[of], str(AlarmName.SILENT)) for of in (BUS, RECEIVER)),
    ]
    accounts = account(
        played, played, [Fault(Kind.BUS, 1.0, 6.0, BUS), Fault(Kind.POSITION, 1.0, 6.0, RECEIVER), pause]
    )
    assert (accounts.named, accounts.false) == (3, [])


def test_damage_on_a_slow_link_may_be_said_late(played: Played) -> None:
    noise = Fault(Kind.NOISE, 10.0, 13.0, 0)
    played.said = [(12.0, LINKS[0], str(AlarmName.LOSS)), (33.0, LINKS[0], str(SessionCode.FRAMES_DAMAGED))]
    accounts = account(played, played, [noise])
    assert (accounts.named, accounts.false) == (1, [])


def test_an_alarm_that_stays_is_false_except_of_a_replaced_hub(played: Played) -> None:
    played.standing = [("FL", str(AlarmName.MISPLACED)), (LINKS[0], str(AlarmName.LOSS))]
    assert [name for _, _, name in account(played, played, []).false] == ["loss"]


def test_numbers_are_compared_with_the_quiet_day(played: Played, tmp_path: Path) -> None:
    quiet = Played([[] for _ in range(HUBS + 1)])
    for day, value in ((quiet, 2.0), (played, 2.3)):
        mean = WeightedMean()
        mean.add(value, 0.1)
        day.means["FL", "Rs"] = mean
        day.single_std["FL", "Rs"] = [0.1]
    accounts = account(played, quiet, [])
    assert accounts.compared == 1
    assert accounts.worst == pytest.approx(3.0)


def test_damaged_frames_make_no_valid_speed_of_several_turns() -> None:
    """The noise of day 18 takes two contacts, one of them without a gap where it would be at a steady speed."""
    faults, _ = planned_day(18)
    noise = next(fault for fault in faults if fault.kind is Kind.NOISE)
    flips = parse_fault("flip:rate=0.3", (18, faults.index(noise)))
    setup = next(setup for setup in day_vehicle().wheel_setups() if setup.position == POSITIONS[noise.target])
    pipeline, decoder, results = Pipeline((setup,), setup, ("kinematic",)), FrameDecoder(), []
    pieces = frame_pieces(hub_chunks(18, noise.target, faults, 9.0))
    for step, sent in groupby(pieces, lambda piece: (piece[1] - START_NS) // STEP_NS):
        data = b"".join(part.data for _, _, parts in sent for part in parts)
        if noise.begin_s <= step * STEP_NS * 1e-9 < noise.end_s:
            data = b"".join(chunk.data for chunk in flips([Chunk("", 0, data)]))
        results += pipeline.frames("link", decoder.feed(data), START_NS + step * STEP_NS)
    speeds = [result.estimates[1] for result in [*results, *pipeline.finish()]]
    wrong = [speed for speed in speeds if abs(speed.value - 39.06) > 0.02 * 39.06 + 3.0 * speed.std]
    assert [speed.status for speed in wrong if speed.status is Status.VALID] == []
    assert any(result.revolution.turns == 3 for result in results)


@pytest.mark.parametrize(
    "kinds",
    [
        (Kind.UNPLUGGED, Kind.DISK),
        pytest.param(
            (Kind.UNPLUGGED, Kind.PAUSE, Kind.CLOCK, Kind.DISK, Kind.POSITION), marks=pytest.mark.slow, id="longer"
        ),
    ],
)
def test_a_short_day_is_accounted_for(kinds: tuple[Kind, ...]) -> None:
    accounts, faults = rehearse(1, quiet_day(10.0), kinds=kinds)
    assert len(faults) == len(kinds)
    assert accounts.missed == []
    assert accounts.false == []
    assert accounts.unaccounted == []
    assert accounts.lost[Kind.UNPLUGGED] > 0
    assert accounts.lost[Kind.DISK] > 0
    assert accounts.compared > 20
    assert accounts.worst < 1.0
