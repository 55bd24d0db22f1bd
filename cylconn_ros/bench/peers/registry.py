"""Everybody who takes part, by name."""

from __future__ import annotations

from cylconn_ros.bench.peers import drake, exudyn, mujoco, ours, pinocchio, pybullet, scipy
from cylconn_ros.bench.peers.solver import Contestant

CONTESTANTS: dict[str, Contestant] = {
    contestant.name: contestant
    for room in (ours, scipy, mujoco, drake, pinocchio, pybullet, exudyn)
    for contestant in room.CONTESTANTS
}
