"""Bytes in, bytes out: what the connector node does with messages, without ROS.

The node subscribes to :attr:`Answering.inputs` and publishes the answers; a replay feeds the same
class from a recording and gets the same bytes.
"""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.synchronizer import STREAMS, Matched, SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.messages import cdr_decoder, joint_command, prefix_decoder_lane, statistics
from cylconn_ros.messages.cdr_encoder import JointStateWriter, StampedWriter, StateWriter
from cylconn_ros.messages.health import Health
from cylconn_ros.messages.prefix import BODIES, STREAM_OF, Forms, body_of
from cylconn_ros.messages.prefix_decoder_lane import Lane
from cylconn_ros.messages.templates import Letters
from cylconn_ros.ros.executor.fused import Parts
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

POSE = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
JOINT_STATE = "sensor_msgs/msg/JointState"
STATE = "cylconn_ros/msg/ConnectorState"

COMMAND = "~/command"
_TYPES = {"pose": POSE, "twist": TWIST, "odom": ODOMETRY, "load": WRENCH}
STATE_TOPIC, JOINTS_TOPIC = "~/state", "~/joint_state"

# Name, type, in the order of Answer's fields after the stamp.
OUTPUTS = (
    ("body_a/wrench", WRENCH),
    ("body_b/wrench", WRENCH),
    (STATE_TOPIC, STATE),
    (JOINTS_TOPIC, JOINT_STATE),
)

_JOINTS = (
    layout.LENGTH, layout.ANGLE, layout.VELOCITY, layout.ANGULAR_VELOCITY, layout.FORCE,
    layout.MOMENT,
)  # fmt: skip


class Answer(NamedTuple):
    """The messages that answer a sample.

    Without state where nothing could be computed or nobody wants it, and without joint state.
    """

    stamp: int  # ns
    wrench_a: bytes
    wrench_b: bytes
    state: bytes | None
    joint_state: bytes | None


class Input(NamedTuple):
    """A topic that is read: its type, and what takes its messages."""

    type: str
    receive: Callable[[bytes], Answer | None]


def input_names(scene: Scene) -> list[str]:
    """Topics read for a scene: motion and load of every moving body, and commands."""
    return [*(f"{BODIES[body]}/{topic}" for body, topic in _of_bodies(scene)), COMMAND]


def _of_bodies(scene: Scene) -> list[tuple[int, str]]:
    """Body and topic of every input about a body."""
    motion = ("odom",) if scene.input == "odometry" else ("pose", "twist")
    moving = [index for index, body in enumerate(scene.bodies) if body.kind != "fixed"]
    return [(body, topic) for body in moving for topic in (*motion, "load")]


ANY_SAMPLE = np.zeros(layout.NSAMPLE)
"""A sample that every connector can answer."""
ANY_SAMPLE[[layout.A_POSE + 6, layout.B_POSE + 6]] = 1.0

# Parameters that what is remembered depends on; a change of these begins a new history.
_HISTORY = ("input", "period", "method", "latency", "body_", "node_", "reference.")


class Answering:
    """Answer samples that arrive as messages; nothing that arrives makes it raise.

    Attributes
    ----------
    imposed
        What is imposed on slide and spin, by the scene or by the last command.
    held
        The last message of every load, by relative topic: what acts until the next.
    wanted
        Whether somebody wants an output that is there for tools, ``~/state`` or ``~/joint_state``.
    solve
        What takes a complete sample of a connector that is solved together with others.

    Raises SceneError at construction where the connector cannot serve the scene.
    """

    def __init__(self, scene: Scene, previous: Answering | None = None) -> None:
        """Serve ``scene``, taking over from ``previous`` if given (:meth:`take_over`)."""
        self.scene = scene
        self.connector = Connector(scene)
        self._prepare()
        self.imposed = joint_command.in_scene(scene.command)
        self.held: dict[str, bytes] = {}
        self.matcher = SampleMatcher(scene)
        self.wanted: Callable[[str], bool] = lambda _: True
        self.solve: Callable[[Matched, float], Answer | None] | None = None
        self.lane, self._forms = Lane(self.matcher), Forms(scene)
        self._seen: tuple[tuple[int, bytes], ...] = ()  # held when somebody last looked
        self.health = Health()
        self.inputs = self._make_inputs()
        self._out = np.zeros(layout.NOUT)
        world_axes = scene.wrench.axes == "world"
        frames = [scene.world_frame if world_axes else body.frame for body in scene.bodies]
        self._wrenches = [StampedWriter(frame) for frame in frames]
        self._state = StateWriter(scene.body_a.frame, self.connector.method)
        self._joints = JointStateWriter(scene.body_a.frame, joint_command.COMPONENTS)
        self.letters = Letters(
            [
                *(writer.write(0, np.zeros(6)) for writer in self._wrenches),
                self._state.write(0, self._out),
                self._joints.write(0, *np.zeros((3, len(joint_command.COMPONENTS)))),
            ],
            [
                *(writer.blocks for writer in self._wrenches),
                self._state.blocks,
                self._joints.blocks,
            ],
        )
        self.letters.write(0, self._out)  # compiled now
        self._answered: int | None = None  # the stamp of the last answer, which ``out`` holds
        self.continues = False
        if previous is not None:
            self.take_over(previous)

    def _prepare(self) -> None:
        """Have everything compiled now, not while a sample waits."""
        self.connector.step(ANY_SAMPLE, 1e-3)
        self.connector.reset()
        prefix_decoder_lane.prepare(self.scene)
        statistics.note_one(np.zeros(statistics.NTALLY), np.zeros(layout.NOUT), 0.0, 0.0)

    def take_over(self, previous: Answering) -> None:
        """Take the counts of ``previous``, which is not to be used again, and what it has in force.

        It also hands over its history where the change of scene allows it (:attr:`continues`), and
        what commands impose where the scene's own ``command`` has not changed.
        """
        self.continues = _same(previous.scene, self.scene, _HISTORY)
        self.health, self.wanted = previous.health, previous.wanted
        self.held = {name: data for name, data in previous.held.items() if name in self.inputs}
        self.matcher.take_over(previous.matcher, history=self.continues)
        if self.continues:
            self.connector.memory = previous.connector.memory
            self._out[:], self._answered = previous._out, previous._answered
        memory = self.connector.memory
        kept = self.keep_imposed(previous)
        self.connector.memory = memory  # imposed motion goes on from where it has got to
        self._impose({name: new for name, new in self.imposed.items() if name not in kept})

    def keep_imposed(self, previous: Answering) -> dict[str, joint_command.Imposition]:
        """Impose what ``previous`` does by command; raises ValueError where the method cannot."""
        kept = {
            name: imposed
            for name, imposed in previous.imposed.items()
            if _same(previous.scene, self.scene, f"command.{name}.")
        }
        self._impose(kept)
        return kept

    def reset(self) -> None:
        """Forget the reference configuration and all history; the next sample begins a new one.

        Loads and commands hold.
        """
        self.connector.begin_anew()
        self.lane.give_back(self._ordinary)
        self.matcher.forget()
        self._answered = None

    def settle(self) -> None:
        """Count what is held for a sample that does not go on; to be called now and then."""
        held = self.lane.held
        if held and held == self._seen:
            self.lane.give_back(self._ordinary)
        self._seen = held

    def release(self) -> None:
        """Impose what the scene's parameters say, whatever was commanded."""
        self._impose(joint_command.in_scene(self.scene.command))

    @property
    def scene_in_force(self) -> Scene:
        """The scene with what commands impose in the place of its own ``command``."""
        return dataclasses.replace(self.scene, command=joint_command.as_parameters(self.imposed))

    @property
    def parts(self) -> Parts:
        """What answers, for :class:`~cylconn_ros.ros.executor.fused.Straight` to work on."""
        return Parts(self.lane, self.connector.lend(), self._out, self.health.numbers, self.letters)

    @property
    def timing(self) -> slice:
        """The bytes of a state that tell how long the answer took."""
        return self._state.timing

    @property
    def out(self) -> np.ndarray:
        """(NOUT,) the numbers of the last answer (core/layout.py)."""
        return self._out

    @property
    def between_samples(self) -> bool:
        """Whether samples have come, and nothing is held for the next."""
        matcher = self.matcher
        return not (self.lane.held or matcher.waiting or matcher.last_stamp is None)

    def went_on(self, stamp: int, before: int | None, samples: int) -> None:
        """Take note of ``samples`` that were answered elsewhere, with the arrays of this.

        ``stamp`` and ``before``: of the last of them, and of the one before it, if any.
        """
        self.matcher.went_on(stamp, before, samples)
        self._answered = stamp

    def rows(self, name: str, stamps: np.ndarray, outs: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: messages of an output for (n,) stamps in ns, (n, NOUT) answers."""
        if name == STATE_TOPIC:
            return self._state.rows(stamps, outs)
        if name == JOINTS_TOPIC:
            return self._joints.rows(stamps, outs[:, _JOINTS].reshape(len(outs), 3, 2))
        body = BODIES.index(name.partition("/")[0])
        at = (layout.FORCE_A, layout.FORCE_B)[body]
        return self._wrenches[body].rows(stamps, outs[:, at : at + 6])

    def zero(self) -> Answer | None:
        """Zero wrenches for when samples have stopped, or None where none was ever answered.

        Their stamp is one nanosecond after the last sample's: the newest for whoever applies the
        newest wrench, and never the stamp a plant in lock step is waiting for.
        """
        return None if self._answered is None else self._only_wrenches(self._answered + 1)

    def _make_inputs(self) -> dict[str, Input]:
        inputs: dict[str, Input] = {}
        for body, topic in _of_bodies(self.scene):
            name = f"{BODIES[body]}/{topic}"
            if name in STREAM_OF:
                receive = functools.partial(self._motion, STREAM_OF[name])
            else:
                receive = functools.partial(self._receive, functools.partial(self._load, body))
            inputs[name] = Input(_TYPES[topic], receive)
        inputs[COMMAND] = Input(JOINT_STATE, functools.partial(self._receive, self._command))
        return inputs

    def _motion(self, stream: int, data: bytes) -> Answer | None:
        """Take what tells a motion: by the express lane, or else on the ordinary way."""
        taken = self.lane.take(stream, data)
        if taken is True:
            return None
        if taken is False:
            self.lane.give_back(self._ordinary)
            return self._ordinary(stream, data)
        try:
            return self._serve(taken, time.perf_counter())
        except Exception as error:
            return self._failed(error, taken)

    def _ordinary(self, stream: int, data: bytes) -> Answer | None:
        return self._receive(functools.partial(self._decode, stream), data)

    def _decode(self, stream: int, data: bytes) -> Matched | None:
        """Take a message on the ordinary way, and let those like it take the express lane."""
        self.lane.learn(stream, self._forms.of(stream, data), data)
        matcher, body = self.matcher, body_of(stream)
        if stream >= len(STREAMS):
            stamp, frame, child, pose, twist = cdr_decoder.read_odometry(data)
            return matcher.odometry(body, stamp, (frame, child), pose, twist)
        if stream & 1:
            return matcher.twist(body, *cdr_decoder.read_twist(data))
        return matcher.pose(body, *cdr_decoder.read_pose(data))

    def _load(self, body: int, data: bytes) -> None:
        _, frame, load = cdr_decoder.read_wrench(data)
        self.matcher.load(body, frame, load)
        self.held[f"{BODIES[body]}/load"] = data

    def _command(self, data: bytes) -> None:
        try:
            self._impose(joint_command.read(cdr_decoder.read_joint_state(data)))
            self.health.commands += 1
        except joint_command.CommandError as error:
            self.health.refused += 1
            self.health.refusal = str(error)

    def _impose(self, imposed: dict[str, joint_command.Imposition]) -> None:
        for name, imposition in imposed.items():
            self.connector.impose(name, *imposition)
            self.imposed[name] = imposition

    def _receive(self, take: Callable[[bytes], Matched | None], data: bytes) -> Answer | None:
        """Take one message; the answer where it completes a sample."""
        begin = time.perf_counter()
        matched = None
        try:
            matched = take(data)
            return None if matched is None else self._serve(matched, begin)
        except cdr_decoder.CdrError as error:
            self.health.undecodable += 1
            self.health.undecodable_text = str(error)
            return None
        except Exception as error:
            return self._failed(error, matched)

    def _failed(self, error: Exception, matched: Matched | None) -> Answer | None:
        """Go on: counted, reported, and no force."""
        self.health.failed += 1
        self.health.failure = f"{type(error).__name__}: {error}"
        if matched is None:
            return None
        self._out[:], self._answered = 0.0, matched.stamp
        return self._only_wrenches(matched.stamp)

    def _serve(self, matched: Matched, begin: float) -> Answer | None:
        if matched.repeated and self._answered is not None:
            return self._write(self._answered)
        if self.solve is not None:
            return self.solve(matched, begin)
        if matched.restarted:
            self.connector.begin_anew()
        self.connector.step(self.matcher.sample, matched.h, self._out)
        return self.finish(matched.stamp, matched.h, begin)

    def finish(self, stamp: int, h: float, begin: float) -> Answer:
        """The answer in :attr:`out` to the sample at ``stamp``; computing began at ``begin``."""
        out = self._out
        out[layout.COMPUTING_TIME] = time.perf_counter() - begin
        self._answered = stamp
        statistics.note_one(self.health.numbers, out, h, self.scene.period)
        return self._write(stamp)

    def _write(self, stamp: int) -> Answer:
        letters = self.letters
        letters.write(stamp, self._out)
        state = letters.message(2) if self.wanted(STATE_TOPIC) else None
        joints = letters.message(3) if self.wanted(JOINTS_TOPIC) else None
        return Answer(stamp, letters.message(0), letters.message(1), state, joints)

    def _only_wrenches(self, stamp: int) -> Answer:
        nothing = np.zeros(6)
        wrenches = [writer.write(stamp, nothing) for writer in self._wrenches]
        return Answer(stamp, wrenches[0], wrenches[1], None, None)


def _same(before: Scene, after: Scene, beginning: str | tuple[str, ...]) -> bool:
    """Whether the parameters whose names begin so have not changed."""
    old, new = before.parameters(), after.parameters()
    return all(show(old[name]) == show(new[name]) for name in old if name.startswith(beginning))
