"""Run one node in a process: arguments, signals, spinning, exit code.

A process ends within _ENDING s of a signal, even if the middleware or a callback hangs.
"""

from __future__ import annotations

import contextlib
import errno
import faulthandler
import gc
import os
import resource
import signal
import sys
import threading
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
_ENDING = 3.0  # s from the signal to the end of the process; ros2 launch sends SIGTERM after 5 s
_DESCRIPTORS = 40  # file descriptors that a node with one connector needs while it starts
_is_ending = threading.Event()


class ManagedNode(Protocol):
    """Interface of a node that :func:`run` can run, besides that of rclpy.node.Node."""

    done: Future  # its result is the exit code; a signal sets it to 0

    def handle_error(self, error: Exception) -> bool:
        """Handle an exception of a callback; return True to continue spinning."""

    def finish(self) -> None:
        """Send and write the last data; node and context are still valid."""


def run(name: str, make: Callable[[Arguments], Node], usage: str, argv: list[str] | None) -> int:
    """Run the node returned by ``make`` until it is done or a signal arrives; return the exit code.

    Exit code 2, with a one-line message, for invalid arguments or parameters; 1 for too few file
    descriptors, or if the shutdown hangs; 130 if interrupted while compiling.
    """
    _open_standard_streams()
    try:
        with interruptible(name, (signal.SIGINT, signal.SIGTERM)):
            arguments = read_arguments(sys.argv[1:] if argv is None else argv, name)
            if arguments.help or arguments.version:
                print(usage if arguments.help else __version__)
                return OK
            _check_descriptors()
            return _run(make, arguments)
    except KeyboardInterrupt:
        return OK
    except (SceneError, UsageError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return WRONG_USE
    except NameValidationException as error:
        print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr)
        return WRONG_USE
    except OSError as error:
        if error.errno not in (errno.EMFILE, errno.ENFILE):
            raise
        print(f"{name}: {_too_few_descriptors()}", file=sys.stderr)
        return FAILED


def _open_standard_streams() -> None:
    """Open /dev/null in place of a closed standard stream (as after ``2>&-`` in a shell).

    Otherwise the next file or socket gets its number, and log messages are written into it.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, closefd=False))


def _check_descriptors() -> None:
    """Raise OSError (EMFILE) if fewer than _DESCRIPTORS file descriptors are allowed."""
    if 0 <= resource.getrlimit(resource.RLIMIT_NOFILE)[0] < _DESCRIPTORS:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))


def _too_few_descriptors() -> str:
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return (
        f"too few file descriptors: the limit is {limit}, a node needs at least {_DESCRIPTORS}; "
        "raise it (ulimit -n 1024)"
    )


def _run(make: Callable[[Arguments], Node], arguments: Arguments) -> int:
    try:
        with _context(arguments):
            return _spin_until_done(make(arguments))
    except SceneError as error:  # perhaps the parameters are in another node's block
        raise SceneError("; ".join([str(error), *arguments.unused])) from None


def announce_compiling(kernel: Callable[..., Any], log: Callable[[str], object]) -> None:
    """Log one line if the first call of ``kernel`` will compile it."""
    if not is_ready(kernel):
        log("compiling the physics, once: takes some seconds; later starts use the cache")


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
        _limit_ending()
        rclpy.try_shutdown()
        _has_ended()


def _limit_ending() -> None:
    """Exit the process _ENDING s after the first call, unless :func:`_has_ended` is called before.

    The exit code is 1; the stack of every thread is written to stderr. Fast DDS may deadlock if
    peers leave while a topic is destroyed (its issues 6193 and 6502). A Python thread could not
    detect this, because the hanging thread may hold the GIL.
    """
    if not _is_ending.is_set():
        _is_ending.set()
        with contextlib.suppress(AttributeError, OSError, RuntimeError, ValueError):  # no stderr
            faulthandler.dump_traceback_later(_ENDING, exit=True)


def _has_ended() -> None:
    """Cancel the exit of :func:`_limit_ending`."""
    _is_ending.clear()
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
            _limit_ending()  # a callback that is running may hang, too
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
        _limit_ending()
        executor.remove_node(node)
        node.finish()
        node.destroy_node()
        executor.shutdown()
        for s, handler in previous.items():
            signal.signal(s, handler)
    return done.result() if done.done() else OK
