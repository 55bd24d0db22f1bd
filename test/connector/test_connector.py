"""The public step: named inputs, one array, wrong arrays of every kind."""

import math
import time
from typing import Any

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.core.jit import COMPILED

POSE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
TWIST = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def connector() -> cr.Connector:
    return cr.Connector(cr.load(cr.shipped("coast")))


def sample() -> np.ndarray:
    return np.array([*POSE, *[0.0] * 6, *POSE, *TWIST, *[0.0] * 12])


def test_named_inputs_give_the_numbers_of_the_array(connector: cr.Connector) -> None:
    connector.reset()
    expected = connector.step(sample())
    connector.reset()
    result = connector.step(pose_b=POSE, twist_b=TWIST)  # body a is fixed
    assert result.array.tolist() == expected.tolist()
    assert result.force_b.tolist() == expected[layout.FORCE_B : layout.FORCE_B + 3].tolist()
    assert result.torque_a.tolist() == expected[layout.TORQUE_A : layout.TORQUE_A + 3].tolist()
    assert result["normal_force"] == expected[layout.NORMAL_FORCE] > 0.0
    assert (result.status, result.regime, result.flags) == ("ok", "slip", ())
    assert "regime" in result.names
    connector.reset()
    pushed = connector.step(pose_b=POSE, twist_b=TWIST, load_b=[0, 0, -100.0, 0, 0, 0])
    assert pushed["normal_force"] == pytest.approx(result["normal_force"] + 100.0)


def test_an_unusable_sample_is_a_status_and_not_an_error(connector: cr.Connector) -> None:
    connector.reset()
    result = connector.step(pose_b=POSE, twist_b=[math.nan, *TWIST[1:]])
    assert (result.status, result.force_b.tolist()) == ("not finite or too large", [0.0] * 3)


@pytest.mark.parametrize(
    ("inputs", "text"),
    [
        ({"twist_b": TWIST}, "pose_b: must be given, as body_b.kind = 'free'"),
        ({"pose_b": POSE[:3], "twist_b": TWIST}, r"pose_b: has the shape \(3,\), must be \(7,\)"),
        ({"pose_b": "here", "twist_b": TWIST}, "pose_b = 'here': must be an array of"),
        ({"pose": POSE}, "pose: no such input; there are pose_a, twist_a"),
        ({"sample": sample(), "pose_b": POSE}, "pose_b: must not be given together with sample"),
    ],
)
def test_wrong_named_inputs_are_refused(connector: cr.Connector, inputs, text) -> None:
    with pytest.raises(ValueError, match=text):
        connector.step(**inputs)


READ_ONLY = sample()
READ_ONLY.flags.writeable = False
CONVERTED: dict[str, Any] = {
    "list": sample().tolist(),
    "float32": sample().astype(np.float32),
    "integers": sample().astype(np.int64),
    "Fortran order": np.asfortranarray(sample()),
    "every second of a larger array": np.repeat(sample(), 2)[::2],
    "read only": READ_ONLY,
}
REFUSED: dict[str, Any] = {
    "short": sample()[:5],
    "long": np.append(sample(), 0.0),
    "two dimensions": sample()[None],
    "text": "sample",
    "object": object(),
    "complex": sample() + 1j,
}
OUTPUTS: dict[str, Any] = {
    "short": np.empty(10),
    "long": np.empty(layout.NOUT + 1),
    "list": [0.0] * layout.NOUT,
    "float32": np.empty(layout.NOUT, np.float32),
    "strided": np.empty(2 * layout.NOUT)[::2],
    "read only": np.frombuffer(bytes(8 * layout.NOUT)),
    "two dimensions": np.empty((1, layout.NOUT)),
}


@pytest.mark.parametrize("kind", CONVERTED)
def test_other_kinds_of_samples_are_converted(connector: cr.Connector, kind: str) -> None:
    connector.reset()
    expected = connector.step(sample())
    connector.reset()
    assert connector.step(CONVERTED[kind]).tolist() == expected.tolist()


@pytest.mark.parametrize("kind", REFUSED)
def test_wrong_samples_are_refused(connector: cr.Connector, kind: str) -> None:
    with pytest.raises(ValueError, match=r"^sample"):
        connector.step(REFUSED[kind])


@pytest.mark.parametrize("kind", OUTPUTS)
def test_wrong_outputs_are_refused(connector: cr.Connector, kind: str) -> None:
    with pytest.raises(ValueError, match=r"^out"):
        connector.step(sample(), out=OUTPUTS[kind])


def test_no_argument_makes_the_step_compile_again(connector: cr.Connector) -> None:
    from cylconn_ros.connector import batch

    connector.step(sample())
    started = time.monotonic()
    for value in [*CONVERTED.values(), *REFUSED.values()]:
        for h in (0, 1e-3, np.float32(1e-3), True):
            try:
                connector.step(value, h=h)  # type: ignore[arg-type]
            except ValueError:
                continue
    assert time.monotonic() - started < 10.0  # a compilation takes tens of seconds
    if COMPILED:
        assert len(batch.step.signatures) == 1  # type: ignore[attr-defined]


def test_a_run_is_as_many_steps() -> None:
    scene = cr.load(cr.shipped("coast"))
    one, other = cr.Connector(scene), cr.Connector(scene)
    rows = np.array([sample() for _ in range(4)])
    expected = [one.step(row).copy() for row in rows]
    assert other.run(rows).tolist() == np.array(expected).tolist()
    for rows_, text in ((rows[:, :5], "samples"), ([[1.0]], "samples"), (rows[0], "samples")):
        with pytest.raises(ValueError, match=text):
            other.run(rows_)
    with pytest.raises(ValueError, match="since"):
        other.run(rows, since=[0.0])
    with pytest.raises(ValueError, match="outs"):
        other.run(rows, outs=np.empty((4, 10)))
    with pytest.raises(ValueError, match="since: must be given"):
        cr.Connector(scene.replace({"period": 0.0})).run(rows)
