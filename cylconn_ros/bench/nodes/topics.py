"""Topics of every node in the node benchmark, with types: four inputs, three outputs."""

from __future__ import annotations

from cylconn_ros.messages.pipeline import STATE
from cylconn_ros.scene.inputs import POSE, TWIST, WRENCH

INPUTS = {"body_a/pose": POSE, "body_a/twist": TWIST, "body_b/pose": POSE, "body_b/twist": TWIST}
OUTPUTS = {"body_a/wrench": WRENCH, "body_b/wrench": WRENCH, "connector/state": STATE}
