"""Timeout of the samples (reported once, in time, with few checks) and incomplete samples."""

from types import SimpleNamespace
from typing import Any

import pytest

from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.ros.connector.watchdog import (
    LONGEST,
    PATIENCE,
    SOON,
    IncompleteSamples,
    LoadWait,
    Watchdog,
    WatchdogEvent,
)
from cylconn_ros.scene.scene import Scene

MS = 1_000_000
SCENE = {
    "node_a.orientation": [0, 0, 0, 1],
    "body_b.mass": 2.0,
    "body_b.inertia": [1, 0, 0, 1, 0, 1],
}
TOGETHER = "pose and twist with the same stamp never arrive together"


def timeouts(times: list[float], timeout: float, until: float) -> tuple[list[float], int]:
    """Times of the timeouts of samples at ``times``, and the number of checks."""
    watchdog, found, checks = Watchdog(), [], 0
    now = 0.0
    while now < until:
        last = max((time for time in times if time <= now), default=None)
        if watchdog.check(now, last, timeout) is WatchdogEvent.TIMEOUT:
            found.append(now)
        checks += 1
        assert watchdog.due > now
        now = watchdog.due
    return found, checks


def test_timeout_is_reported_once():
    found, checks = timeouts([0.001 * k for k in range(1, 1001)], 0.1, 3.0)
    assert found == [pytest.approx(1.1, abs=0.002)]
    assert checks < 40


def test_each_sample_times_out_if_samples_are_further_apart_than_the_timeout():
    times = [0.5, 0.77, 1.2, 1.41, 1.83]
    found, _ = timeouts(times, 0.05, 3.0)
    assert found == [pytest.approx(time + 0.05, abs=1e-6) for time in times]


def test_long_timeout_needs_few_checks_and_infinite_timeout_never_ends():
    times = [0.01 * k for k in range(1000)]
    assert timeouts(times, 20.0, 10.0)[1] <= 10.0 / LONGEST + 1
    assert timeouts([0.0], float("inf"), 100.0)[0] == []


def test_resumed_input_is_reported_and_reset_clears_the_timeout():
    watchdog = Watchdog()
    assert watchdog.check(0.0, None, 0.1) is WatchdogEvent.NONE
    assert watchdog.due == pytest.approx(SOON)
    assert watchdog.check(1.0, 0.5, 0.1) is WatchdogEvent.TIMEOUT
    assert watchdog.check(1.1, 0.5, 0.1) is WatchdogEvent.NONE
    assert watchdog.timed_out
    assert watchdog.check(1.2, 1.15, 0.1) is WatchdogEvent.RESUMED
    assert watchdog.check(2.0, 1.15, 0.1) is WatchdogEvent.TIMEOUT
    watchdog.reset()
    assert (watchdog.timed_out, watchdog.due) == (False, 0.0)


def warnings(feed, seconds=3.0, **rules):
    """Warnings while ``feed(matcher, k)`` is called fifty times per second."""
    scene = Scene.from_parameters({**SCENE, **rules})
    matcher, incomplete = SampleMatcher(scene), IncompleteSamples()
    found = []
    for k in range(round(50 * seconds)):
        feed(matcher, k)
        found.append(incomplete.check(matcher, scene, 0.02 * k))
    return [text for text in found if text]


def pose(matcher, stamp):
    matcher.pose(1, stamp, "world", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))


def twist(matcher, stamp):
    matcher.twist(1, stamp, "world", (0.0,) * 6)


def test_no_warning_for_complete_samples_or_without_messages():
    def both(matcher, k):
        pose(matcher, k * MS)
        twist(matcher, k * MS)

    assert warnings(both) == []
    assert warnings(lambda *_: None) == []


def test_warning_names_the_reason_and_the_remedy():
    def offset_stamps(offset):
        def feed(matcher, k):
            pose(matcher, 10 * k * MS)
            twist(matcher, 10 * k * MS + offset)

        return feed

    count = round(50 * PATIENCE) + 1
    begin = f"no complete sample in 2 s; received: body_b/pose {count}"
    both = f"{begin}, body_b/twist {count}; {TOGETHER}: their stamps differ by at least "
    assert warnings(lambda m, k: pose(m, k * MS)) == [
        f"{begin}; {TOGETHER} (missing: body_b/twist)"
    ]
    assert warnings(offset_stamps(500), period=0.01) == [
        f"{both}5e-07 s; set stamp_tolerance (now 0 s) above that"
    ]
    assert warnings(offset_stamps(5 * MS), period=0.01) == [
        f"{both}0.005 s, half a period or more; publish both with the same header stamp"
    ]
    assert warnings(offset_stamps(500), period=0.01, stamp_tolerance=1e-6) == []
    assert len(warnings(offset_stamps(500), seconds=40.0, period=0.01)) == 2


@pytest.mark.parametrize(
    ("last", "silent", "overtaken", "expected"),
    [
        (None, True, False, 0.020),  # the first sample: its load may be on its way
        (7, True, False, 0.002),  # a publisher that has sent nothing so far
        (7, False, False, 0.020),
        (7, False, True, 0.002),
    ],
)
def test_a_sample_waits_for_its_load(last, silent, overtaken, expected):
    pipeline: Any = SimpleNamespace(
        scene=SimpleNamespace(period=0.002),
        decoder=SimpleNamespace(waiting=8, is_overtaken=overtaken),
        matcher=SimpleNamespace(last_stamp=last, loads=SimpleNamespace(silent=silent)),
    )
    wait = LoadWait()
    assert not wait.is_over(pipeline, 1.0)
    assert not wait.is_over(pipeline, 1.0 + expected - 1e-4)
    assert wait.is_over(pipeline, 1.0 + expected + 1e-4)
