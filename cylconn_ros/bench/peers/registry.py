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
    scipy,
)
from cylconn_ros.bench.peers.solver import Solver

SOLVERS: dict[str, Solver] = {
    solver.name: solver
    for module in (ours, scipy, mujoco, mujoco_friction, drake, pinocchio, pybullet, exudyn)
    for solver in module.SOLVERS
}
