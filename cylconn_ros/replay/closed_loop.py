"""What-if: simulate forward from a recorded state, with the recorded loads and commands.

Replay computes the wrench for the recorded motion. The closed loop lets the motion follow: the
plant starts with poses and twists of the first recorded sample, and its bodies move under the
wrenches of the connector, under the recorded loads and with the recorded commands.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.samples import SampleArrays, synchronized_samples
from cylconn_ros.recording.unstamped import command_topic, preloads
from cylconn_ros.replay.replay import follows, for_motion
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation import run as simulated
from cylconn_ros.simulation.closed_loop import run_loop, times
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
Command = dict[str, joint_command.Imposition] | float
"""Motion or force by component; or the preload, N."""
Commands = list[tuple[int, Command]]

_BLOCK = 2048  # samples per call at most


@dataclasses.dataclass(frozen=True)
class Motion:
    """The first history of a recording.

    Attributes
    ----------
        samples: its complete samples.
        follows: whether it followed from wrenches of the scene with which it was read.
        commands: log time or stamp (ns since the first sample) and content of each command.
    """

    samples: SampleArrays
    follows: bool
    commands: Commands


def recorded_motion(run: Run, scene: Scene, remap: dict[str, str] | None = None) -> Motion:
    """Read the motion of a recording until its stamps go back; raises RecordingError if none."""
    found = SampleArrays.collect(synchronized_samples(run, scene, remap))
    again = np.flatnonzero(found.restarted[1:])
    if len(again):
        found = found[: int(again[0]) + 1]
    if len(found) < 2 or not np.isfinite(found.samples[0]).all():
        raise RecordingError(
            f"{run.path}: no state to start from: {len(found)} complete samples "
            "(pose and twist with the same stamp)"
        )
    return Motion(found, follows(run.metadata, scene), _commands(run, scene))


def along(scene: Scene, motion: Motion) -> Array:
    """Return the outputs (n, NOUT) of the connector for the recorded motion and commands."""
    recorded = motion.samples
    outs = np.empty((len(recorded), layout.NOUT))
    connector = Connector(for_motion(scene, motion.follows))
    since = recorded.stamps - recorded.stamps[0]
    first = np.searchsorted(since, [at for at, _ in motion.commands])
    edges = sorted({0, *first.tolist(), len(recorded)})
    commands = list(zip(first.tolist(), (content for _, content in motion.commands), strict=True))
    for begin, end in itertools.pairwise(edges):
        while commands and commands[0][0] <= begin:
            _follow(connector, commands.pop(0)[1])
        connector.run(recorded.samples[begin:end], recorded.h[begin:end], outs[begin:end])
    return outs


def simulate_from(scene: Scene, motion: Motion, progress: Progress | None = None) -> simulated.Run:
    """Simulate the scene from the first recorded sample, as long as the recording.

    Args:
        scene: its period is that of the simulation; 0: the usual one of the recording.
        motion: of :func:`recorded_motion`.
        progress: called with (done, total) samples.

    Raises SceneError for a scene that cannot be simulated.
    """
    recorded = motion.samples
    if scene.period <= 0.0:
        scene = dataclasses.replace(scene, period=float(np.median(recorded.h[1:])))
    plant, connector = Plant(scene), Connector(scene)
    plant.state[:] = recorded.samples[0, layout.MOTION]
    handle, par, mem, period = connector.kernel_arguments()
    step = round(period * 1e9)
    since = recorded.stamps - recorded.stamps[0]
    samples = int(since[-1]) // step + 1
    # The inputs change at few samples, or at each: a call covers those with the same inputs.
    held = np.searchsorted(since, np.arange(samples) * step + step // 2, side="right") - 1
    loads = recorded.samples[held][:, layout.LOADS]
    starts = {0, *range(0, samples, _BLOCK)}
    starts |= {int(k) + 1 for k in np.flatnonzero((np.diff(loads, axis=0) != 0.0).any(axis=1))}
    commands = [(-(-max(at, 0) // step), content) for at, content in motion.commands]
    starts |= {at for at, _ in commands if at < samples}
    edges = [*sorted(starts), samples]
    rows = np.empty((samples, layout.NSAMPLE))
    outs, energy = np.empty((samples, layout.NOUT)), np.empty(samples)
    delay = scene.plant_latency
    sent, acting = np.zeros((int(delay) + 1, 12)), np.zeros(12)
    for begin, end in itertools.pairwise(edges):
        while commands and commands[0][0] <= begin:
            _follow(connector, commands.pop(0)[1])
        handle, par, mem, period = connector.kernel_arguments()
        plant.loads[:] = loads[begin]
        run_loop(
            handle, par, mem, period, plant.par, plant.state, plant.loads, delay, sent, acting,
            rows[begin:end], outs[begin:end], energy[begin:end],
        )  # fmt: skip
        if progress is not None:
            progress(end, samples)
    plant.move(plant.state, samples)
    time = times(scene, samples)
    return simulated.Run(scene, time, rows[:, layout.MOTION], outs, energy, connector, plant)


def _follow(connector: Connector, command: Command) -> None:
    if isinstance(command, float):
        if connector.scene.friction.on:
            connector.set_preload(command)
        return
    for name, imposition in command.items():
        connector.impose(name, *imposition)


def _commands(run: Run, scene: Scene) -> Commands:
    """Read the commands with the time of each since the first sample, ns."""
    found = _joint_commands(run, scene)
    if pressed := preloads(run):
        first = _first_log_time(run)
        found += [(int(at) - first, float(value)) for at, value in zip(*pressed, strict=True)]
    return sorted(found, key=lambda command: command[0])


def _joint_commands(run: Run, scene: Scene) -> Commands:
    topic = command_topic(run)
    if topic is None:
        return []
    # Log times of commands and of the first sample's messages are of one clock.
    first = _first_log_time(run)
    found: Commands = []
    for log_time, _, data in run.raw(topic):
        try:
            content = joint_command.read_message(data, scene)
        except ValueError:
            continue
        found.append((log_time - first, content))
    return found


def _first_log_time(run: Run) -> int:
    """Log time of the first pose or odometry."""
    motion = [t for t in run.types if t.endswith(("/pose", "/odom")) and run.counts[t]]
    return min(run.table(topic).log_time[0] for topic in motion) if motion else 0
