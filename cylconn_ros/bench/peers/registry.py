"""All solvers, by name."""

from __future__ import annotations

from cylconn_ros.bench.peers import (
    drake,
    exudyn,
    mujoco,
    mujoco_friction,
    ours,
    pinocchio,
    pybullet,
)
from cylconn_ros.bench.peers.equations import solvers as equations
from cylconn_ros.bench.peers.solver import Solver

SOLVERS: dict[str, Solver] = {
    solver.name: solver
    for module in (ours, equations, mujoco, mujoco_friction, drake, pinocchio, pybullet, exudyn)
    for solver in module.SOLVERS
}
