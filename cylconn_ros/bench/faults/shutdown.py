"""Shutdown and storage faults: the last wrench is zero and the recording is complete."""

from __future__ import annotations

import math
import resource
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from lifecycle_msgs.srv import ChangeState

from cylconn_ros.bench.faults.fault import ClosedLoop, FaultCase, node, sleeve
from cylconn_ros.bench.faults.simulator import Simulator
from cylconn_ros.errors import ProcessError
from cylconn_ros.process.child import Child
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.salvage import salvage

_STREAM = 0.3  # s of samples before and after the shutdown
_INTERVAL = 0.001  # s between samples
_DEACTIVATE, _SHUTDOWN = 4, 7  # lifecycle_msgs/Transition
_DISK_SPACE = 1_000_000  # bytes until the disk is full: several chunks of 0.1 s of a recording

Shutdown = Callable[[Child, Simulator], None]


def cases(folder: Path, quick: bool) -> Iterator[tuple[FaultCase, Simulator]]:
    """Run every shutdown and storage fault; yield it with its simulator."""
    shutdowns: dict[str, Shutdown] = {
        "SIGINT": lambda child, _: child.signal(signal.SIGINT),
        "SIGTERM": lambda child, _: child.signal(signal.SIGTERM),
        "SIGHUP": lambda child, _: child.signal(signal.SIGHUP),
        "lifecycle deactivate": lambda _, simulator: request_transition(simulator, _DEACTIVATE),
        "lifecycle shutdown": lambda _, simulator: request_transition(simulator, _SHUTDOWN),
    }
    if quick:
        shutdowns = {name: shutdowns[name] for name in ("SIGHUP", "lifecycle deactivate")}
    for name, shutdown in shutdowns.items():
        simulator = Simulator(sleeve())
        try:
            yield shut_down(folder, simulator, name, shutdown), simulator
        finally:
            simulator.close()
    for fault in (disk_full,) if quick else (input_timeout, disk_full):
        simulator = Simulator(sleeve())
        try:
            yield fault(folder, simulator), simulator
        finally:
            simulator.close()


def request_transition(simulator: Simulator, transition: int) -> None:
    """Request a lifecycle transition of the node without waiting for the response.

    Raises ProcessError if the node has no lifecycle service.
    """
    client = simulator.node.create_client(ChangeState, "/connector/change_state")
    if not client.wait_for_service(10.0):
        raise ProcessError("the connector has no lifecycle service")
    request = ChangeState.Request()
    request.transition.id = transition
    client.call_async(request)


def _stream(loop: ClosedLoop, seconds: float) -> None:
    """Send samples without waiting for outputs; the newest wrench acts."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        loop.send()
        loop.simulator.take(round(_INTERVAL * 1e9))
        loop.move()


def shut_down(folder: Path, simulator: Simulator, name: str, shutdown: Shutdown) -> FaultCase:
    """Shut a recording node down while samples arrive."""
    case = FaultCase(f"{name} under load", "a zero wrench last, newest stamp; complete recording")
    directory = folder / name.replace(" ", "_")
    record = ("record.enabled:=true", f"record.directory:={directory}")
    with node("connector", simulator.scene, folder, *record) as child:
        simulator.connect(lambda: child.running)
        received = simulator.record()
        loop = ClosedLoop(simulator)
        _stream(loop, _STREAM)
        shutdown(child, simulator)
        _stream(loop, _STREAM)
        simulator.spin_for(1.0)
        (run,) = directory.iterdir()
        closed = simulator.spin_until((run / "metadata.yaml").exists, 10.0)
        case.check(closed, "the recording is not closed")
        if "deactivate" not in name:
            code = child.wait(30.0)
            case.check(code == 0, f"exit code {code}")
        newest = max(wrench.stamp for wrench in received)
        last = received[-1]
        zero = not any(last.values)
        case.observe(f"{len(received)} wrenches, the last is {'zero' if zero else last.values}",
                     wrenches=len(received))  # fmt: skip
        case.check(zero, "the last wrench is not zero")
        case.check(last.stamp == newest, "the last wrench does not have the newest stamp")
        recording = read_run(run)
        recorded = recording.table("/body_b/wrench")
        case.observe(f"recording {'complete' if recording.incomplete is None else 'incomplete'}, "
                     f"{len(recorded)} wrenches", recorded=len(recorded))  # fmt: skip
        case.check(recording.incomplete is None, "the recording is incomplete")
        case.check(int(recorded.stamp[-1]) == last.stamp, "the last wrench is not recorded")
        case.check(len(recorded) == len(received), "recorded and received wrenches differ")
        case.check("Traceback" not in child.output, "a traceback was printed")
    return case


def input_timeout(folder: Path, simulator: Simulator) -> FaultCase:
    """Samples stop arriving."""
    timeout = simulator.scene.timeout
    case = FaultCase("samples stop", f"one zero wrench after {timeout:g} s")
    with node("connector", simulator.scene, folder) as child:
        simulator.connect(lambda: child.running)
        loop = ClosedLoop(simulator)
        loop.run(50)
        received, begin = simulator.record(), time.monotonic()
        arrived = simulator.spin_until(lambda: received, 5.0)
        took = time.monotonic() - begin
        simulator.spin_for(5.0 * timeout)
        case.observe(f"after {1e3 * took:.0f} ms", after=took)
        case.check(arrived and not any(received[0].values), "no zero wrench")
        case.check(len(received) == 1, f"{len(received)} wrenches")
        case.check(took >= 0.9 * timeout, "too early")
        took = loop.recovery_time()
        case.observe(f"next output after {1e3 * took:.1f} ms", recovery=took)
        case.check(math.isfinite(took) and loop.wrench.any(), "does not recover")
    return case


def disk_full(folder: Path, simulator: Simulator) -> FaultCase:
    """The disk is full; a limit of the file size stands for it."""
    case = FaultCase("disk full while recording", "error in diagnostics, losses counted; continues")
    directory = folder / "full"
    record = ("record.enabled:=true", f"record.directory:={directory}", "record.compression:=none")
    with node("connector", simulator.scene, folder, *record) as child:
        simulator.connect(lambda: child.running)
        resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (_DISK_SPACE, _DISK_SPACE))
        loop = ClosedLoop(simulator)
        loop.run(1500)
        reported = simulator.spin_until(
            lambda: simulator.status("recording").get("level") == "2", 10.0
        )
        message = simulator.status("recording").get("message", "").partition(": ")[0]
        case.observe(f"diagnostics: “{message}”")
        case.check(reported, "no error in diagnostics")
        lost = simulator.counts()["messages lost"]
        case.observe(f"{lost} messages counted as lost", lost=lost)
        case.check(lost > 0, "losses not counted")
        loop.run(50)
        case.check(not loop.unanswered, "does not continue")
    (run,) = directory.iterdir()
    recovered = read_run(salvage(run).directory)
    case.observe(f"{recovered.counts['/body_b/wrench']} samples recovered")
    case.check(recovered.counts["/body_b/wrench"] > 10, "no samples recovered")
    return case
