"""Parameter groups of inputs and outputs: wrenches, their limits, QoS, and recording.

SI units, radians, quaternions x, y, z, w. Rules between parameters: validation.py.
"""

from __future__ import annotations

import dataclasses
import math

from cylconn_ros.scene.schema import parameter

INF = math.inf


@dataclasses.dataclass(frozen=True, kw_only=True)
class Wrench:
    """How the published wrenches are expressed, and how they are meant to be held.

    Example::

        scene = scene.replace({"wrench": {"axes": "world", "point": "com"}})
    """

    axes: str = parameter(
        "body", choices=("body", "world"), shared="coupled", doc="Axes of the published wrenches."
    )
    point: str = parameter(
        "origin",
        choices=("origin", "com"),
        shared="coupled",
        doc="Point of the published torques: the body frame's origin or the mass centre.",
    )
    hold: str = parameter(
        "world",
        choices=("world", "body"),
        shared="coupled",
        doc="How a wrench is held until the next: fixed in world axes, or turning with the body.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """Output limits. One factor scales the wrenches of both bodies to keep them.

    Example::

        limits = cr.Limits(force=1000.0, torque=50.0)
    """

    force: float = parameter(INF, gt=0.0, unit="N", doc="Maximum published force.")
    torque: float = parameter(INF, gt=0.0, unit="N.m", doc="Maximum published torque.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointNames:
    """Names of slide and spin in ~/joint_state and ~/command, as in a robot model.

    Example::

        scene = scene.replace({"joint_names": {"slide": "left_rail", "spin": "left_axle"}})
    """

    slide: str = parameter(
        "slide", read_only=True, doc="Name of the slide in ~/joint_state and ~/command."
    )
    spin: str = parameter(
        "spin", read_only=True, doc="Name of the spin in ~/joint_state and ~/command."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class FeedForward:
    """The effort that a controller adds so that friction does not act on its axis.

    Example::

        scene = scene.replace({"feed_forward": {"enabled": True, "share": 0.8}})
    """

    enabled: bool = parameter(
        False,
        read_only=True,
        doc="Publish ~/feed_forward: while the joint slips the opposite of friction, while it "
        "sticks a share of the break-away force towards the velocity on ~/reference.",
    )
    share: float = parameter(
        0.9,
        ge=0.0,
        le=1.0,
        unit="1",
        doc="Share of the friction limit that is published while the joint sticks; below 1 the "
        "joint does not move by it.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class QualityOfService:
    """Quality of service of the node's inputs.

    Example::

        scene = scene.replace({"qos.reliability": "best_effort"})
    """

    reliability: str = parameter(
        "reliable",
        choices=("reliable", "best_effort"),
        read_only=True,
        node=True,
        doc="Of the inputs. reliable: no message is lost; best_effort publishers (sensor data QoS) "
        "are not received. best_effort: publishers of both kinds are received, messages may be "
        "lost. qos_overrides has priority.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Access:
    """What other nodes may change.

    Example::

        scene = scene.replace({"access.frozen": True})
    """

    frozen: bool = parameter(
        False,
        read_only=True,
        node=True,
        doc="Refuse changes of parameters, commands, and the services for recordings and reset, "
        "from the first activation on.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """Recording of a run.

    Example::

        record = cr.Record(enabled=True, directory="runs")
    """

    enabled: bool = parameter(
        False,
        read_only=True,
        node=True,
        doc="Record from activation on (a service starts a recording later).",
    )
    directory: str = parameter(
        "runs",
        node=True,
        doc="Directory for runs, one subdirectory each. While the node runs it can be changed to "
        "a directory below the one given at the start.",
    )
    compression: str = parameter(
        "zstd", choices=("none", "zstd"), node=True, doc="Compression of the MCAP chunks."
    )
