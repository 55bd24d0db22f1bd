"""Friction of a slider on a driven arm, simulated with Pinocchio (pip install pin).

The arm turns about z in a vertical plane; the slider's mass centre is 4 cm beside the slot. The
joint's reaction is what the recursive Newton-Euler algorithm leaves in ``data.f``.
"""

import numpy as np
import pinocchio as pin

import cylconn_ros as cr

H, END = 0.001, 1.0


def make_model():
    """Arm and slider; the slider's frame is node b, and its axes are those of node a."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    arm = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    inertia = pin.Inertia(1.0, np.array([0.25, 0.0, 0.0]), np.diag([0.01, 0.01, 0.0175]))
    model.appendBodyToJoint(arm, inertia, pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.0]))
    slider = model.addJoint(arm, pin.JointModelPX(), place, "slide")
    inertia = pin.Inertia(0.6, np.array([0.03, 0.04, 0.0]), 0.004 * np.eye(3))
    model.appendBodyToJoint(slider, inertia, pin.SE3.Identity())
    return model, slider


def simulate():
    """The angle of the arm, the slide, and their rates at END."""
    model, slider = make_model()
    data = model.createData()
    friction = cr.mechanism.Friction(cr.Friction(coefficient=0.25, radius=0.01, overlap=0.12))
    q, v = np.array([0.3, 0.0]), np.array([0.0, 0.5])
    for k in range(round(END / H)):
        torque = np.array([3.0 + 2.5 * np.sin(4.0 * H * k), 0.0])
        mass = np.array(pin.crba(model, data, q))
        mass = np.triu(mass) + np.triu(mass, 1).T
        free = np.linalg.solve(mass, torque - pin.nle(model, data, q, v))

        def reaction(a, q=q, v=v):
            pin.rnea(model, data, q, v, a)
            return data.f[slider].vector  # force and moment on the slider, at its frame

        friction.step(
            h=H, velocity=v, mass_matrix=mass, free_acceleration=free,
            axes=[[0.0, 1.0], [0.0, 0.0]], reaction=reaction, length=q[1],
        )  # fmt: skip
        v = v + H * (free + np.linalg.solve(mass, friction.generalised_force))
        q = pin.integrate(model, q, H * v)
    return np.array([*q, *v])


if __name__ == "__main__":
    print("arm {:.9f} rad, slide {:.9f} m, rates {:.9f} rad/s, {:.9f} m/s".format(*simulate()))
