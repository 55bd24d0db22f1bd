"""When samples have stopped: told once for each last sample, in time, and with few looks."""

import pytest

from cylconn_ros.ros.connector.watchdog import LONGEST, SOON, News, Silence


def told(times: list[float], timeout: float, until: float) -> tuple[list[float], int]:
    """When samples answered at ``times`` are told to have stopped, and the looks that took."""
    silence, stops, looks = Silence(), [], 0
    now = 0.0
    while now < until:
        answered = max((time for time in times if time <= now), default=None)
        if silence.look(now, answered, timeout) is News.STOPPED:
            stops.append(now)
        looks += 1
        assert silence.due > now
        now = silence.due
    return stops, looks


def test_a_stop_is_told_when_the_timeout_is_over_and_once():
    stops, looks = told([0.001 * k for k in range(1, 1001)], 0.1, 3.0)
    assert stops == [pytest.approx(1.1, abs=0.002)]
    assert looks < 40


def test_samples_farther_apart_than_the_timeout_are_each_followed_by_a_zero_wrench():
    times = [0.5, 0.77, 1.2, 1.41, 1.83]
    stops, _ = told(times, 0.05, 3.0)
    assert stops == [pytest.approx(time + 0.05, abs=1e-6) for time in times]


def test_a_long_timeout_is_looked_at_seldom_and_none_never_ends():
    times = [0.01 * k for k in range(1000)]
    assert told(times, 20.0, 10.0)[1] <= 10.0 / LONGEST + 1
    assert told([0.0], float("inf"), 100.0)[0] == []


def test_what_comes_back_is_told_and_a_new_history_is_not_silent():
    silence = Silence()
    assert silence.look(0.0, None, 0.1) is News.NONE
    assert silence.due == pytest.approx(SOON)
    assert silence.look(1.0, 0.5, 0.1) is News.STOPPED
    assert silence.look(1.1, 0.5, 0.1) is News.NONE
    assert silence.silent
    assert silence.look(1.2, 1.15, 0.1) is News.BACK
    assert silence.look(2.0, 1.15, 0.1) is News.STOPPED
    silence.forget()
    assert (silence.silent, silence.due) == (False, 0.0)
