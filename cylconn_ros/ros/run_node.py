"""A process with one node: arguments, signals, spinning, exit code."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from cylconn_ros import __version__
from cylconn_ros.core.jit import is_ready
from cylconn_ros.errors import SceneError
from cylconn_ros.process.interrupt import interruptible
from cylconn_ros.ros.arguments import Arguments, UsageError, read_arguments
from cylconn_ros.ros.middleware import prefer_quiet_writers

OK, FAILED, WRONG_USE = 0, 1, 2
_LETTING_GO = 30.0  # s for what takes some ms


class Served(Protocol):
    """What a node must have besides being one."""

    done: Future  # its result is the exit code; a signal completes it with 0

    def caught(self, error: Exception) -> bool:
        """Take note of what a callback raised; whether to go on."""

    def finish(self) -> None:
        """Send and write what is to be last; node and context are still valid."""


def run(name: str, make: Callable[[Arguments], Node], usage: str, argv: list[str] | None) -> int:
    """Run the node that ``make`` gives until it is done or a signal comes; return the exit code.

    Exit code 2, with one plain line, where arguments or parameters cannot be used; 130 where it was
    interrupted while compiling.
    """
    try:
        with interruptible(name, (signal.SIGINT, signal.SIGTERM)):
            arguments = read_arguments(sys.argv[1:] if argv is None else argv, name)
            if arguments.help or arguments.version:
                print(usage if arguments.help else __version__)
                return OK
            return _run(make, arguments)
    except KeyboardInterrupt:
        return OK
    except (SceneError, UsageError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return WRONG_USE
    except NameValidationException as error:
        print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr)
        return WRONG_USE


def _run(make: Callable[[Arguments], Node], arguments: Arguments) -> int:
    try:
        with _context(arguments):
            return _serve(make(arguments))
    except SceneError as error:  # perhaps because its parameters stand in another node's block
        raise SceneError("; ".join([str(error), *arguments.unused])) from None


def announce_compiling(entry: Callable[..., Any], say: Callable[[str], object]) -> None:
    """Say so, in one line, where the first call of an entry of the physics will compile it."""
    if not is_ready(entry):
        say("compiling the physics, once: half a minute or more; later starts do without")


@contextlib.contextmanager
def _context(arguments: Arguments) -> Iterator[None]:
    """A ROS context that outlives the first signal, so that last messages can be sent."""
    prefer_quiet_writers()
    try:
        rclpy.init(args=arguments.ros, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rclpy makes of arguments that rcl refuses
        raise UsageError(" ".join(str(error).split())) from None
    try:
        yield
    finally:
        with _not_for_ever():
            rclpy.try_shutdown()


@contextlib.contextmanager
def _not_for_ever() -> Iterator[None]:
    """Leave the process where the middleware does not let go within the block.

    With exit code 1, and what every thread does on stderr. Fast DDS may lock up where peers leave
    while a topic is given back (its issues 6193 and 6502). No thread of Python's could see to this,
    as the one that hangs may hold the interpreter.
    """
    with contextlib.suppress(AttributeError, OSError, RuntimeError, ValueError):  # no stderr
        faulthandler.dump_traceback_later(_LETTING_GO, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def _spin(executor: Any, node: Served) -> None:
    """Spin until the node is done, or a callback raises."""
    try:
        executor.spin_until_future_complete(node.done, timeout_sec=1e5)
    except ExternalShutdownException:
        raise
    except Exception as error:
        if not node.caught(error):
            traceback.print_exc()
            node.done.set_result(FAILED)
        time.sleep(0.001)  # a callback that always fails shall not take the machine


def _ending() -> list[signal.Signals]:
    """Signals that end a node in order; a closed terminal's too, unless it is ignored (nohup)."""
    hung_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGINT, signal.SIGTERM, *hung_up]


def _serve(node: Node) -> int:
    executor = EventsExecutor()
    executor.add_node(node)
    done = node.done

    def stop(_signal: int, _frame: object) -> None:
        if not done.done():
            done.set_result(OK)

    previous = {s: signal.signal(s, stop) for s in _ending()}
    gc.collect()
    gc.freeze()  # what exists by now stays: no use in looking through it again and again
    try:
        while not done.done():
            _spin(executor, node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        for s in previous:  # Ctrl-C may come twice: to the group, and from the launcher
            signal.signal(s, signal.SIG_IGN)
        executor.remove_node(node)
        node.finish()
        with _not_for_ever():
            node.destroy_node()
            executor.shutdown()
        for s, handler in previous.items():
            signal.signal(s, handler)
    return done.result() if done.done() else OK
