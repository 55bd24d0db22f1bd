"""A robot arm opens a drawer that slides, binds as the hand moves sideways, and comes free again.

python docs/how_to/arm_opens_drawer.py [RUN] [PICTURE]

The hook of the arm (models/arm_opens_drawer.xml) pulls at the handle bar of the drawer. From 2 s on
the hand moves sideways to 0.19 m from the middle, holds there, and returns. RUN is a recorded run
for ``cylconn report``; PICTURE compares with a joint friction of MuJoCo (frictionloss) that equals
the connector's at the start.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

import cylconn_ros as cr

MODEL = Path(__file__).parents[2] / "models" / "arm_opens_drawer.xml"
FRICTION = cr.Friction(coefficient=0.3, radius=0.01, overlap=0.1)  # binds from 0.167 m on
END, SPEED = 6.0, 0.1  # s, m/s
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])  # axes of the hand
NAMES = ("displacement", "velocity", "force_friction", "normal_force", "regime")


class Arm:
    """The arm under impedance control of its hand: a spring to a target that moves ahead."""

    def __init__(self, model, data):
        self.model, self.data = model, data
        self.site = model.site("grip").id
        self.jacobian = np.zeros((6, model.nv))
        self.x = 0.19
        self.place(np.array([self.x, 0.0, 0.5]), np.array([0.0, -0.5, -1.3, -1.3, 0.0, 0.0]))

    def errors(self, target):
        """Distance to the target, and the turn from the hand's orientation to DOWN."""
        turn = DOWN @ self.data.site_xmat[self.site].reshape(3, 3).T
        axis = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        return target - self.data.site_xpos[self.site], 0.5 * np.array(axis)

    def place(self, target, joints):
        """Solve the inverse kinematics by damped least squares."""
        self.data.qpos[1:] = joints
        for _ in range(200):
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            error = np.concatenate(self.errors(target))
            j = self.update_jacobian()[:, 1:]
            step = j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(6), error)
            self.data.qpos[1:] += np.clip(step, -0.2, 0.2)

    def update_jacobian(self):
        """The hand's Jacobian, which is also kept."""
        j = self.jacobian
        mujoco.mj_jacSite(self.model, self.data, j[:3], j[3:], self.site)
        return j

    def control(self, time):
        """Set the motors: pull along x at SPEED, at most 5 cm ahead of the hand."""
        y = np.interp(time, [2.0, 3.0, 4.0, 5.0], [0.0, 0.19, 0.19, 0.0])
        rate = 0.19 if 2.0 < time < 3.0 else -0.19 if 4.0 < time < 5.0 else 0.0
        ahead = self.data.site_xpos[self.site][0] + 0.05
        self.x = min(self.x + SPEED * self.model.opt.timestep, ahead)
        far, turn = self.errors(np.array([self.x, y, 0.5]))
        speed = self.update_jacobian() @ self.data.qvel
        force = 800.0 * far + 60.0 * (np.array([SPEED, rate, 0.0]) - speed[:3])
        torque = 30.0 * turn - 2.0 * speed[3:]
        joints = self.jacobian.T @ np.concatenate([force, torque])
        self.data.ctrl[:] = joints[1:] + self.data.qfrc_bias[1:]


def simulate(path=None):
    """The friction of the connector; (n,) of time and of each of NAMES."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    arm = Arm(model, data)
    friction = cr.mujoco.Friction(model, data, slide="slide", scene=FRICTION)
    record = friction.record(path) if path else None
    rows = []
    while data.time < END:
        arm.control(data.time)
        friction.step()
        if record:
            record.write()
        rows.append([friction.time, *(np.ravel(friction.result[name])[0] for name in NAMES)])
    if record:
        record.close()
    return np.array(rows).T


def simulate_frictionloss(loss):
    """MuJoCo's own joint friction: time, displacement and velocity."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    model.dof_frictionloss[model.joint("slide").dofadr[0]] = loss
    data = mujoco.MjData(model)
    arm = Arm(model, data)
    rows = []
    while data.time < END:
        arm.control(data.time)
        mujoco.mj_step(model, data)
        rows.append([data.time, data.joint("slide").qpos[0], data.joint("slide").qvel[0]])
    return np.array(rows).T


def events(time, regime):
    """When the drawer begins to slide or stops: (s, slides), shorter than 0.1 s left out."""
    found, since = [(0.0, regime[0] == 2)], 0
    for k in range(1, len(time)):
        if regime[k] != regime[k - 1]:
            since = k
        if time[k] - time[since] > 0.1 and (regime[k] == 2) != found[-1][1]:
            found.append((float(time[since]), regime[k] == 2))
    return found


def draw(path, ours, theirs, loss):
    """Draw both motions, the friction force and its limit."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    time, place, _, force, normal, regime = ours
    figure, axes = plt.subplots(3, 1, figsize=(8, 7), sharex=True, layout="constrained")
    offset = np.interp(time, [2.0, 3.0, 4.0, 5.0], [0.0, 190.0, 190.0, 0.0])
    axes[0].plot(time, offset, color="tab:green")
    axes[0].axhline(1e3 * 0.1 / (2 * 0.3), color="grey", linestyle="--")
    axes[0].set_ylabel("hand beside\nthe middle [mm]")
    axes[0].text(0.0, 172.0, "L/(2 μ): binds above", color="grey")
    axes[1].plot(time, 1e3 * place, label="connector: μ = 0.3, L = 100 mm")
    axes[1].plot(theirs[0], 1e3 * theirs[1], label=f"MuJoCo frictionloss = {loss:.2f} N")
    axes[1].set_ylabel("drawer open [mm]")
    axes[1].legend(loc="lower right")
    axes[2].plot(time, -force, label="connector: friction force")
    axes[2].plot(time, 0.3 * normal, linewidth=0.8, color="tab:red", label="its limit μ FN")
    axes[2].axhline(loss, color="tab:orange", label="MuJoCo frictionloss")
    axes[2].set_ylabel("force [N]")
    axes[2].set_xlabel("time [s]")
    axes[2].legend()
    for one in axes[1:]:
        one.fill_between(time, 0, 1, where=regime == 1, alpha=0.15, color="k",
                         transform=one.get_xaxis_transform())  # fmt: skip
    figure.suptitle("A robot arm opens a drawer (grey: the drawer sticks)")
    figure.savefig(path, dpi=110)


def main(arguments):
    """Simulate both, print when the drawer sticks and slides, keep and draw."""
    path, picture = [*arguments, None, None][:2]
    ours = simulate(path)
    for at, slides in events(ours[0], ours[5]):
        print(f"{at:5.2f} s  {'slides' if slides else 'sticks'}")
    loss = float(np.median(-ours[3][(ours[0] > 0.5) & (ours[0] < 1.5)]))
    theirs = simulate_frictionloss(loss)
    stuck = (ours[0] > 3.2) & (ours[0] < 4.2)
    print(
        f"open at 6 s: {ours[1][-1]:.3f} m, with frictionloss {loss:.2f} N: {theirs[1][-1]:.3f} m"
    )
    print(f"pull that does not move it: {np.abs(ours[3][stuck]).max():.1f} N, "
          f"creep in 1 s: {np.ptp(ours[1][stuck]):.1e} m")  # fmt: skip
    if picture:
        draw(picture, ours, theirs, loss)


if __name__ == "__main__":
    main(sys.argv[1:])
