"""Run one node in a process: arguments, signals, spinning, exit code."""

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
from cylconn_ros.ros.middleware import use_default_profile

OK, FAILED, WRONG_USE = 0, 1, 2
_TEARDOWN = 30.0  # s, limit of the middleware's shutdown, which normally takes milliseconds


class ManagedNode(Protocol):
    """Interface of a node that :func:`run` can run, besides that of rclpy.node.Node."""

    done: Future  # its result is the exit code; a signal sets it to 0

    def handle_error(self, error: Exception) -> bool:
        """Handle an exception of a callback; return True to continue spinning."""

    def finish(self) -> None:
        """Send and write the last data; node and context are still valid."""


def run(name: str, make: Callable[[Arguments], Node], usage: str, argv: list[str] | None) -> int:
    """Run the node returned by ``make`` until it is done or a signal arrives; return the exit code.

    Exit code 2, with a one-line message, for invalid arguments or parameters; 130 if interrupted
    while compiling.
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
            return _spin_until_done(make(arguments))
    except SceneError as error:  # perhaps the parameters are in another node's block
        raise SceneError("; ".join([str(error), *arguments.unused])) from None


def announce_compiling(kernel: Callable[..., Any], log: Callable[[str], object]) -> None:
    """Log one line if the first call of ``kernel`` will compile it."""
    if not is_ready(kernel):
        log("compiling the physics, once: takes half a minute or more; later starts use the cache")


@contextlib.contextmanager
def _context(arguments: Arguments) -> Iterator[None]:
    """A ROS context that stays valid after a signal, so that last messages can be sent."""
    use_default_profile()
    try:
        rclpy.init(args=arguments.ros, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # raised by rclpy for arguments that rcl refuses
        raise UsageError(" ".join(str(error).split())) from None
    try:
        yield
    finally:
        with _limited_teardown():
            rclpy.try_shutdown()


@contextlib.contextmanager
def _limited_teardown() -> Iterator[None]:
    """Exit the process if the middleware's shutdown hangs within the block.

    The exit code is 1; the stack of every thread is written to stderr. Fast DDS may deadlock if
    peers leave while a topic is destroyed (its issues 6193 and 6502). A Python thread could not
    detect this, because the hanging thread may hold the GIL.
    """
    with contextlib.suppress(AttributeError, OSError, RuntimeError, ValueError):  # no stderr
        faulthandler.dump_traceback_later(_TEARDOWN, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def _spin(executor: Any, node: ManagedNode) -> None:
    """Spin until the node is done, or a callback raises."""
    try:
        executor.spin_until_future_complete(node.done, timeout_sec=1e5)
    except ExternalShutdownException:
        raise
    except Exception as error:
        if not node.handle_error(error):
            traceback.print_exc()
            node.done.set_result(FAILED)
        time.sleep(0.001)  # limits the load of a callback that always fails


def _termination_signals() -> list[signal.Signals]:
    """Signals that shut a node down in order; SIGHUP included, unless it is ignored (nohup)."""
    hung_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGINT, signal.SIGTERM, *hung_up]


def _spin_until_done(node: Node) -> int:
    executor = EventsExecutor()
    executor.add_node(node)
    done = node.done

    def stop(_signal: int, _frame: object) -> None:
        if not done.done():
            done.set_result(OK)

    previous = {s: signal.signal(s, stop) for s in _termination_signals()}
    gc.collect()
    gc.freeze()  # existing objects are permanent: later collections skip them
    try:
        while not done.done():
            _spin(executor, node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        for s in previous:  # Ctrl-C may arrive twice: to the process group, and from the launcher
            signal.signal(s, signal.SIG_IGN)
        executor.remove_node(node)
        node.finish()
        with _limited_teardown():
            node.destroy_node()
            executor.shutdown()
        for s, handler in previous.items():
            signal.signal(s, handler)
    return done.result() if done.done() else OK
