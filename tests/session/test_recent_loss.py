"""The loss of a link is that of the last seconds."""

import pytest

from gateway.session.recent_loss import WINDOW_S, RecentLoss

S = 1_000_000_000


def test_a_gap_is_forgotten_after_the_window() -> None:
    loss = RecentLoss()
    assert loss.share(0, 0, 0) is None
    assert loss.share(S, 100, 0) == 0.0
    assert loss.share(2 * S, 200, 200) == pytest.approx(0.5)
    shares = [loss.share(second * S, 100 * second, 200) for second in range(3, 20)]
    assert shares[0] == pytest.approx(200 / 500)
    assert [share for second, share in enumerate(shares, 3) if second > 2 + WINDOW_S] == [0.0] * 7


def test_a_link_that_becomes_bad_after_a_day_is_told() -> None:
    loss = RecentLoss()
    for second in range(0, 86_400, 10):
        loss.share(second * S, 100 * second, 0)
    assert loss.share(86_401 * S, 8_640_000, 300) > 0.2


def test_late_frames_are_no_gain() -> None:
    loss = RecentLoss()
    loss.share(0, 100, 50)
    loss.share(S, 200, 50)
    loss.share(20 * S, 300, 50)
    assert loss.share(21 * S, 400, 10) == 0.0
