"""Loads act on the sample with their stamp in any order of arrival; others from their stamp on."""

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cylconn_ros.connector.load_history import (
    ALWAYS,
    CAPACITY,
    IF_REGULAR,
    MOST_MISSED,
    PAUSE,
    REGULAR_FROM,
)
from cylconn_ros.connector.synchronizer import MOST_WAITING, SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene

MS = 1_000_000
INERTIA = [0.002, 0.0, 0.0, 0.003, 0.0, 0.004]
POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
ORDERS = list(itertools.permutations(("load", "pose", "twist")))


class Simulator:
    """Messages of body B; a load of x N at sample x. ``answers``: stamp in ms and load in N."""

    def __init__(self, awaited: int = IF_REGULAR, **changes: float) -> None:
        parameters = {
            "node_a.orientation": [0, 0, 0, 1],
            "body_b.mass": 1,
            "body_b.inertia": INERTIA,
        }
        self.matcher = SampleMatcher(Scene.from_parameters(parameters | changes))
        self.matcher.expects = lambda *_: awaited
        self.answers: list[tuple[int, float]] = []

    def send(self, quantity: str, stamp: int, value: float | None = None) -> None:
        """Send a message with a stamp in ms; answer the samples that it completes."""
        m, at = self.matcher, stamp * MS
        if quantity == "pose":
            found = m.pose(1, at, "world", POSE)
        elif quantity == "twist":
            found = m.twist(1, at, "world", (0.0,) * 6)
        else:
            force = float(stamp if value is None else value)
            found = m.load(1, at, "world", (force, *(0.0,) * 5))
        while found is not None:
            self.answers.append((found.stamp // MS, float(m.sample[layout.B_LOAD])))
            found = m.next()

    def sample(self, stamp: int) -> None:
        """Send a sample without a load."""
        self.send("pose", stamp)
        self.send("twist", stamp)

    def give_up(self) -> None:
        """Wait for the oldest sample's load no longer."""
        waiting = self.matcher.waiting
        assert waiting is not None
        self.matcher.loads.give_up(waiting)
        found = self.matcher.next()
        assert found is not None
        self.answers.append((found.stamp // MS, float(self.matcher.sample[layout.B_LOAD])))

    def state(self, at: int) -> int:
        return int(self.matcher.loads.state[at + 1])


@pytest.mark.parametrize("order", ORDERS)
def test_loads_are_exact_from_the_first_sample_on(order):
    s = Simulator()
    for k in range(1, 9):
        for quantity in order:
            s.send(quantity, k)
    assert s.answers == [(k, float(k)) for k in range(1, 9)]
    assert s.matcher.counts.late_loads == 0


@pytest.mark.parametrize("order", ORDERS)
def test_the_order_may_change_with_every_sample(order):
    s = Simulator()
    for k, other in enumerate(ORDERS, 1):
        for quantity in other:
            s.send(quantity, 2 * k)
        for quantity in order:
            s.send(quantity, 2 * k + 1)
    assert s.answers == [(k, float(k)) for k in range(2, 2 + 2 * len(ORDERS))]


@pytest.mark.parametrize(
    "order",
    list(itertools.permutations((("load", 5), ("pose", 5), ("twist", 5), ("load", 6)))),
)
def test_a_load_of_the_next_sample_may_come_at_any_place(order):
    s = Simulator()
    for k in range(1, 5):
        s.send("load", k)
        s.sample(k)
    for quantity, stamp in order:
        s.send(quantity, stamp)
    s.sample(6)
    # A topic keeps its order: after a newer load, a load that has not arrived never will.
    lost = order[:3] == tuple(one for one in order[:3] if one != ("load", 5))
    assert s.answers[-2:] == [(5, 4.0 if lost else 5.0), (6, 6.0)]
    assert s.matcher.counts.late_loads == lost


@given(st.integers(1, 30), st.randoms(use_true_random=False))
def test_interleaved_messages_give_the_answers_of_the_sorted_ones(count, rng):
    """A load arrives before the sample after the next is complete, in the order of the loads."""
    s, sent = Simulator(), 0
    for k in range(1, count + 1):
        pair = rng.sample(("pose", "twist"), 2)
        for quantity in pair:
            while sent < k + 1 and (sent < k - 2 or rng.random() < 0.5):
                sent += 1
                s.send("load", sent)
            s.send(quantity, k)
    for k in range(sent + 1, count + 1):
        s.send("load", k)
    assert s.answers == [(k, float(k)) for k in range(1, count + 1)]
    assert s.matcher.counts.late_loads == 0


def test_a_load_holds_from_its_stamp_on_until_the_next():
    s = Simulator(0)
    s.sample(10)
    s.send("load", 15)
    s.send("load", 12)  # also if it arrives later
    for stamp in range(11, 18):
        s.sample(stamp)
    loads = dict(s.answers)
    assert [loads[k] for k in (10, 11, 12, 14, 15, 17)] == [0.0, 0.0, 12.0, 12.0, 15.0, 15.0]


def test_a_load_without_stamp_acts_from_the_next_sample_on():
    s = Simulator(0)
    s.send("load", 0, 1.0)
    s.sample(50)
    s.send("load", 52)
    s.send("load", 0, 2.0)
    for stamp in (51, 52, 53):
        s.sample(stamp)
    s.send("load", 0, 3.0)
    s.sample(54)
    assert s.answers == [(50, 1.0), (51, 2.0), (52, 52.0), (53, 52.0), (54, 3.0)]


def test_samples_wait_no_longer_if_their_loads_do_not_come():
    s = Simulator()
    for k in range(1, 1 + MOST_MISSED):
        s.sample(k)
        assert s.matcher.waiting == k * MS
        s.give_up()
    s.sample(50)
    assert s.answers[-1] == (50, 0.0)
    for k in range(51, 51 + PAUSE):  # loads come again, after their samples
        s.sample(k)
        s.send("load", k)
        assert s.answers[-1] == (k, k - 1.0 if k > 51 else 0.0)
    assert s.matcher.counts.late_loads == PAUSE
    s.sample(90)
    s.send("load", 90)
    assert s.answers[-1] == (90, 90.0)


def test_loads_with_the_stamps_of_their_samples_are_awaited_after_a_few():
    s = Simulator(0)
    for k in range(1, 1 + REGULAR_FROM):
        s.send("load", k)
        s.sample(k)
    s.sample(7)
    s.send("load", 7)
    assert s.answers[-1] == (7, 7.0)


def test_loads_of_other_rates_are_not_awaited():
    s = Simulator(0)
    for k in range(1, 60):
        if not k % 10:
            s.send("load", k)
        s.sample(k)
    assert s.answers == [(k, k // 10 * 10.0) for k in range(1, 60)]


def test_a_bounded_number_of_samples_waits():
    s = Simulator()
    for k in range(1, MOST_WAITING + 2):
        assert s.answers == []
        s.sample(k)
    assert s.answers == [(1, 0.0)]
    s.send("load", 3)  # newer than what the second waits for
    assert s.answers == [(1, 0.0), (2, 0.0), (3, 3.0)]


def test_samples_before_a_restart_and_their_loads_are_forgotten():
    for order in ORDERS:
        s = Simulator()
        for k in range(100, 110):
            s.send("load", k)
            s.sample(k)
        s.send("load", 112)
        for k in (1, 2, 3):
            for quantity in order:
                s.send(quantity, k)
        assert s.answers[-3:] == [(1, 1.0), (2, 2.0), (3, 3.0)]
        s.send("load", 4)
        s.sample(4)
        for k in range(108, 120):
            s.sample(k)
            if s.matcher.waiting is not None:
                s.give_up()
        assert s.answers[-1] == (119, 4.0)
        assert s.matcher.counts.unused_loads == 0


def test_a_reset_keeps_the_load_in_force():
    s = Simulator(0)
    s.send("load", 9)
    s.sample(10)
    s.matcher.reset()
    s.sample(1)
    assert s.answers[-1] == (1, 9.0)


def test_loads_that_cannot_act_are_counted():
    s = Simulator(0)
    s.sample(10)
    s.send("load", 11)
    s.sample(12)
    s.send("load", 10)  # older than the one in force
    counts = s.matcher.counts
    assert (counts.unused_loads, counts.load_body) == (1, 1)
    s.send("load", 12 + 1500)  # another clock
    assert (counts.early_loads, counts.load_lead) == (1, 1500 * MS)
    for k in range(CAPACITY):
        s.send("load", 2000 + k)
    assert counts.unused_loads == 3  # the waiting ones are bounded: the oldest are dropped
    s.sample(13)
    assert s.answers[-1] == (13, 11.0)


def test_stamps_within_the_tolerance_are_one_sample():
    s = Simulator(stamp_tolerance=0.001, period=0.01)
    for k in (10, 20, 30):
        s.sample(k)
        assert s.matcher.waiting == k * MS
        s.send("load", k - 1)
    assert s.answers == [(10, 9.0), (20, 19.0), (30, 29.0)]


def test_a_wait_that_the_caller_ends_may_last():
    s = Simulator(ALWAYS)
    for k in range(1, 3 * MOST_MISSED):
        s.sample(k)
        s.give_up()
    assert len(s.answers) == 3 * MOST_MISSED - 1
    s.sample(50)
    assert s.matcher.waiting == 50 * MS


def test_the_order_of_many_random_loads_follows_their_stamps():
    rng, s = random.Random(3), Simulator(0)
    stamps: list[int] = []
    for k in range(1, 400):
        for _ in range(rng.randint(0, 2)):
            stamp = k + rng.randint(0, 20)
            stamps.append(stamp)
            s.send("load", stamp)
        s.sample(k)
        expected = max((stamp for stamp in stamps if stamp <= k), default=0)
        assert s.answers[-1] == (k, float(expected))
