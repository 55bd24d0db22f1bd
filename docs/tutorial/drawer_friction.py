"""The drawer that an arm opens, with the connector's friction and with MuJoCo's own.

    python drawer_friction.py [PICTURE.png]

Both models have one rail, one arm and one motion. MuJoCo's joint has a constant greatest friction
(frictionloss), here the one of the drawer's weight; that of the connector is of the reactions.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import cylconn_ros as cr
from cylconn_ros.importing.from_mujoco import draft_of
from cylconn_ros.mujoco.motion import Motion
from cylconn_ros.mujoco.plant import MujocoPlant
from cylconn_ros.scene.resources import shipped_models

MODEL = shipped_models()["drawer_arm"]
FRICTION = {"friction.coefficient": 0.3, "friction.radius": 0.01, "friction.overlap": 0.1}
STEPS, WEIGHT = 6000, 3.3 * 9.81


def run(with_connector: bool) -> np.ndarray:
    """Time, slide, and pull of the hand along the rail: (STEPS, 3)."""
    scene = draft_of(MODEL, ["drawer"]).scene()
    scene = scene.replace({"constraint": "simulator", "latency": 0.0, **FRICTION})
    plant, connector = MujocoPlant(scene, MODEL, ["drawer"]), cr.Connector(scene)
    if not with_connector:
        joint = plant.model.joint("drawer")
        plant.model.dof_frictionloss[joint.dofadr] = 0.3 * WEIGHT
    motion, rows = Motion(MODEL.with_suffix(".csv")), []
    for _ in range(STEPS):
        time = plant.time_ns * 1e-9
        plant.command(motion.at(time))
        load, wrench = plant.load(1), np.zeros(6)
        if with_connector:
            answer = connector.step(
                pose_b=plant.state[13:20], twist_b=plant.state[20:26], load_b=load
            )
            wrench = np.concatenate([answer.force_b, answer.torque_b])
        rows.append([time, plant.state[13], load[0]])
        plant.step(np.zeros(6), wrench)
    return np.array(rows)


def main() -> None:
    """Draw slide and pull of both."""
    picture = sys.argv[1] if len(sys.argv) > 1 else "drawer_friction.png"
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(8, 5), layout="constrained")
    for with_connector, label in ((True, "connector"), (False, "MuJoCo, frictionloss")):
        found = run(with_connector)
        above.plot(found[:, 0], 1e3 * found[:, 1], label=label)
        below.plot(found[:, 0], found[:, 2], label=label, linewidth=0.8)
        at_side = (found[:, 0] > 2.3) & (found[:, 0] < 3.6)
        moved, pull = 1e3 * np.ptp(found[at_side, 1]), found[at_side, 2].max()
        end = 1e3 * found[-1, 1]
        print(f"{label}: {moved:.1f} mm while beside the middle, {pull:.0f} N; end {end:.0f} mm")
    for axes in (above, below):
        axes.axvspan(2.2, 4.1, color="0.9")
        axes.grid(alpha=0.3)
    above.set_ylabel("slide in mm")
    above.set_title("An arm opens a drawer; grey: the hand is 215 mm beside the middle")
    above.legend()
    below.set_ylabel("pull of the hand in N")
    below.set_xlabel("time in s")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
