"""Friction of a slider on a driven arm, with the equations of Drake (pip install drake).

The mechanism of pinocchio_friction.py. The joint's reaction follows from the spatial Jacobian and
the bias acceleration of the bodies that the joint carries, here of the slider alone.
"""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    JacobianWrtVariable,
    PrismaticJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
)

import cylconn_ros as cr

H, END = 0.001, 1.0
MASS, CENTRE, INERTIA = 0.6, np.array([0.03, 0.04, 0.0]), 0.004 * np.eye(3)


def make_plant():
    """Arm and slider; the slider's frame is node b, and its axes are those of node a."""
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, -9.81, 0.0])
    arm = plant.AddRigidBody("arm", SpatialInertia.MakeFromCentralInertia(
        1.0, [0.25, 0.0, 0.0], RotationalInertia(0.01, 0.01, 0.0175)))  # fmt: skip
    slider = plant.AddRigidBody("slider", SpatialInertia.MakeFromCentralInertia(
        MASS, CENTRE, RotationalInertia(*np.diag(INERTIA))))  # fmt: skip
    plant.AddJoint(RevoluteJoint("turn", plant.world_frame(), arm.body_frame(), [0.0, 0.0, 1.0]))
    plant.AddJoint(PrismaticJoint("slide", arm.body_frame(), slider.body_frame(), [1.0, 0.0, 0.0]))
    plant.Finalize()
    return plant, slider


def simulate():
    """The angle of the arm, the slide, and their rates at END."""
    plant, slider = make_plant()
    context = plant.CreateDefaultContext()
    world, frame = plant.world_frame(), slider.body_frame()
    friction = cr.mechanism.Friction(cr.Friction(coefficient=0.25, radius=0.01, overlap=0.12))
    q, v = np.array([0.3, 0.3]), np.array([0.0, 0.5])
    for k in range(round(END / H)):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        torque = np.array([3.0 + 2.5 * np.sin(4.0 * H * k), 0.0])
        mass = plant.CalcMassMatrix(context)
        known = torque + plant.CalcGravityGeneralizedForces(context)
        free = np.linalg.solve(mass, known - plant.CalcBiasTerm(context))
        pose = plant.CalcRelativeTransform(context, world, frame)
        turn, spin = pose.rotation().matrix(), frame.CalcSpatialVelocityInWorld(context)
        jacobian = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, frame, CENTRE, world, world
        )
        bias = plant.CalcBiasSpatialAcceleration(
            context, JacobianWrtVariable.kV, frame, CENTRE, world, world
        )
        carried = cr.mechanism.RigidBodies(
            mass=np.array([MASS]), position=np.array([pose.multiply(CENTRE)]),
            inertia=np.array([turn @ INERTIA @ turn.T]), spin=np.array([spin.rotational()]),
            jacobian=np.array([np.vstack([jacobian[3:], jacobian[:3]])]),
            bias=np.array([[*bias.translational(), *bias.rotational()]]),
        )  # fmt: skip
        friction.step(
            h=H, velocity=v, mass_matrix=mass, free_acceleration=free,
            axes=[[0.0, 1.0], [0.0, 0.0]], length=q[1],
            reaction=carried.reaction(pose.translation(), turn.T, (0.0, -9.81, 0.0)),
        )  # fmt: skip
        v = v + H * (free + np.linalg.solve(mass, friction.generalised_force))
        q = q + H * v
    return np.array([q[0], q[1] - 0.3, *v])


if __name__ == "__main__":
    print("arm {:.9f} rad, slide {:.9f} m, rates {:.9f} rad/s, {:.9f} m/s".format(*simulate()))
