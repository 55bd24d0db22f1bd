"""Springs, dampers and compliant stops beside what acts on the same component hold the laws."""

import dataclasses

import pytest
from scenes import bundled

from cylconn_ros.laws import library, residuals
from cylconn_ros.laws.summary import LawSummary

WHOLE = 10_000  # samples: a scene to its end


@pytest.mark.parametrize(
    ("name", "besides"),
    [
        ("camera_slider", "a constant force on the slide"),
        ("door_closer", "a lock of the spin that is not yet locked while the seal is pressed"),
        ("soft_close", "nothing"),
    ],
)
def test_whole_motions_hold_the_laws(name: str, besides: str) -> None:
    scene = dataclasses.replace(bundled(name), method="impulse")
    summary = LawSummary()
    for block, index in library.run(scene, WHOLE).blocks():
        summary.add(residuals.check(block, "impulse", in_order=True), block.out, (index,))
    assert {law: one.worst for law, one in summary.laws.items() if not one.holds} == {}, besides
