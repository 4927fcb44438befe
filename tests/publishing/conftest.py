from collections.abc import Iterator, Sequence

import pytest

from gateway.core.estimates.results import Alarm, AlarmChange, RevolutionResult, SessionSnapshot
from gateway.core.links.reconnect import Backoff
from gateway.core.reasons import Reason
from gateway.core.session.reasons import SessionCode
from gateway.publishing import page_listener, sink_worker
from gateway.publishing.sink import Item, PublishedAlarm, PublishedRevolution, PublishedState
from tests.publishing.receivers import PostServer, serving
from tests.testkit.made_results import made  # noqa: F401 - a fixture
from tests.testkit.simulated_session import simulated_session

PRESSURE = Reason(SessionCode.VALUE_BELOW_LIMIT, quantity="pressure_pa", value=180e3, limit=200e3)


@pytest.fixture(scope="session")
def drive() -> tuple[list[RevolutionResult], SessionSnapshot]:
    """Revolutions of four simulated wheels with all estimators, and the state of their session."""
    return simulated_session("sim:demo?speed=max&duration=2.5&seed=3", 2.5)


@pytest.fixture(scope="session")
def items(drive) -> Sequence[Item]:
    """Revolutions, an alarm that is raised and over, and a state."""
    results, snapshot = drive
    alarm = Alarm("FL", "pressure", PRESSURE)
    revolutions = [PublishedRevolution(result.host_ns, result) for result in results]
    last_ns = results[-1].host_ns
    changes = (AlarmChange(alarm, True, 1.0), AlarmChange(alarm, False, 2.0, 1.0))
    return [*revolutions, *(PublishedAlarm(last_ns, change) for change in changes), PublishedState(last_ns, snapshot)]


@pytest.fixture(autouse=True)
def _fast_retries(monkeypatch) -> None:
    monkeypatch.setattr(page_listener, "_ENDED_S", 0.05)  # browsers keep connections on which they ask for nothing
    monkeypatch.setattr(sink_worker, "BACKOFF", Backoff(first_ns=10_000_000, cap_ns=10_000_000))


@pytest.fixture
def server() -> Iterator[PostServer]:
    with serving(PostServer()) as server:
        yield server
