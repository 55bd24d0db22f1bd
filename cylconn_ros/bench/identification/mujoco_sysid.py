"""MuJoCo's system identification (mujoco.sysid) of the guides: friction loss and damping.

It minimises the difference of simulated and measured positions and rates over whole trajectories.
Friction loss is one force in both directions; mu is that force over the weight.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import logging

import numpy as np

from cylconn_ros.bench.identification import sensors
from cylconn_ros.core import layout
from cylconn_ros.recording.samples import SampleArrays

_MODEL = f"""
<mujoco>
  <option timestep="{sensors.PERIOD}" integrator="implicitfast"><flag contact="disable"/></option>
  <worldbody>
    <body name="sleeve">
      <inertial pos="0 0 0" mass="{sensors.MASS}" diaginertia="0.0016 0.0022 0.0022"/>
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom type="sphere" size="0.02"/>
    </body>
  </worldbody>
  <actuator><motor joint="slide"/></actuator>
  <sensor><jointpos joint="slide" name="q"/><jointvel joint="slide" name="v"/></sensor>
</mujoco>
"""


def installed() -> bool:
    """Whether mujoco.sysid can be used (pip install 'mujoco[sysid]')."""
    if importlib.util.find_spec("mujoco") is None:
        return False
    try:
        from mujoco import sysid
    except ImportError:
        return False
    return hasattr(sysid, "optimize")


def mujoco_sysid(samples: SampleArrays) -> dict[str, tuple[float, float, float]]:
    """Return value and 95 % interval of ``coefficient`` and ``c1``."""
    import mujoco
    from mujoco import sysid

    logging.getLogger("absl").setLevel(logging.ERROR)
    spec = mujoco.MjSpec.from_string(_MODEL)
    model = spec.compile()
    rows, n = samples.samples, len(samples)
    seen = rows[:, [layout.B_POSE, layout.B_TWIST]]
    push = rows[:, layout.LOADS][:, 6]
    time = np.arange(n) * sensors.PERIOD
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = seen[0]
    state = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)

    def loss(spec: object, value: float) -> None:
        spec.joint("slide").frictionloss = value  # type: ignore[attr-defined]

    def damping(spec: object, value: float) -> None:
        found = spec.joint("slide")  # type: ignore[attr-defined]
        found.damping = np.array([value, *np.ravel(found.damping)[1:]])

    parameters = sysid.ParameterDict()
    for name, start, most, change in (("loss", 2.0, 20.0, loss), ("damping", 0.5, 10.0, damping)):
        parameters.add(
            sysid.Parameter(
                name, nominal=start, min_value=0.0, max_value=most,
                modifier=lambda s, p, change=change: change(s, float(p.value[0])),
            )
        )  # fmt: skip
    sequences = sysid.ModelSequences(
        "guide", spec, "measured", state, sysid.TimeSeries(time, push[:, None]),
        sysid.TimeSeries.from_names(time, seen, model),
    )  # fmt: skip
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    with contextlib.redirect_stdout(io.StringIO()):  # it prints every iteration
        found, result = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    rest, *_ = residual(result.x, found)
    _, half = sysid.calculate_intervals(rest, result.jac)
    values = dict(zip(("coefficient", "c1"), zip(result.x, half, strict=True), strict=True))
    units = {"coefficient": sensors.WEIGHT, "c1": 1.0}
    return {
        name: (float(x) / units[name], float(x - h) / units[name], float(x + h) / units[name])
        for name, (x, h) in values.items()
    }
