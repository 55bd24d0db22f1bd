"""Kernels of a connector node: loaded from the cache, compiled in a child process.

The compiler holds the interpreter's lock for seconds at a time, so that a thread that compiles
would stop the node's services. A child process compiles into the cache, from which the node then
loads in tenths of a second. ``python -m cylconn_ros.ros.compiling`` is that process: it reads the
scenes as a parameter file (one JSON string on a line), and writes its progress as lines of JSON:
``[functions compiled, functions in all]``, at the end ``"done"``.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cylconn_ros.connector import batch
from cylconn_ros.core import jit
from cylconn_ros.errors import CylconnError, ProcessError
from cylconn_ros.messages.coupled_pipeline import CoupledPipeline
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.methods.dispatch import STEPS
from cylconn_ros.process.child import Child, module_command
from cylconn_ros.ros.executor import fused
from cylconn_ros.scene import parameter_file, shared_bodies
from cylconn_ros.scene.packing import choose_method
from cylconn_ros.scene.scene import Scene, several

_LONGEST_WAIT = 600.0  # s for another process that compiles into the same cache
_DONE = "done"


def load_kernels(scenes: Mapping[str, Scene]) -> None:
    """Load all kernels that a node with connectors by name calls; compile those not in the cache.

    Raises SceneError if a scene cannot be used, NotCompiledError within
    :func:`cylconn_ros.core.kernel_cache.only_stored`.
    """
    for names in shared_bodies.groups(scenes):
        pipelines = [MessagePipeline(scenes[name]) for name in names]
        if len(pipelines) > 1:
            CoupledPipeline(pipelines)
        elif not fused.missing():
            fused.prepare(pipelines[0].parts)


def kernels(methods: Iterable[str]) -> list[Any]:
    """The large ones among the kernels that a node with these methods calls."""
    fast = [] if fused.missing() else fused.KERNELS
    return [*(STEPS[name] for name in methods), batch.step, *fast]


def compile_kernels(scenes: Mapping[str, Scene]) -> None:
    """As :func:`load_kernels`; of several processes with one cache, one compiles at a time."""
    with _alone():
        load_kernels(scenes)


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Wait until no other process compiles into the cache: what it compiles is then loaded."""
    with contextlib.ExitStack() as stack:
        try:
            directory = jit.CACHE_DIRECTORY or os.devnull
            file = stack.enter_context(Path(directory, "compiling.lock").open("w"))
        except OSError:
            yield
            return
        end = time.monotonic() + _LONGEST_WAIT
        while time.monotonic() < end:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                time.sleep(0.1)
        yield


class Compilation:
    """A child process that compiles the kernels for scenes.

    Attributes
    ----------
        scenes: the scenes. done, total: functions compiled, functions in all.
        ended: whether the process has ended. failure: why it failed, else ''.
    """

    def __init__(self, scenes: Mapping[str, Scene]) -> None:
        """Start the process."""
        self.scenes = dict(scenes)
        self.done, self.total = 0, 1
        self.ended, self.failure = False, ""
        self._child: Child | None = None
        command = module_command("cylconn_ros.ros.compiling")
        try:
            self._child = Child("the compiler", command, dict(os.environ), json_lines=True)
            self._child.write(parameter_file.dump_several(scenes))
        except ProcessError as error:
            self._end(str(error))

    def poll(self) -> None:
        """Take over what the process has reported; returns at once."""
        while self._child is not None and not self.ended:
            try:
                message = self._child.read(timeout=0.0)
            except TimeoutError:
                return
            except ProcessError as error:
                self._end(str(error))
                return
            if message == _DONE:
                self._end("")
            else:
                self.done, self.total = message

    def _end(self, failure: str) -> None:
        self.ended, self.failure = True, failure
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.kill()


def _end_with_the_node() -> None:
    """End this process when its input ends, however the node has ended."""
    while os.read(sys.stdin.fileno(), 4096):  # not sys.stdin: it is locked while it reads
        pass
    os._exit(1)


def main() -> int:
    """Run the child process."""

    def write(value: object) -> None:
        with contextlib.suppress(OSError):  # the node has ended
            print(json.dumps(value), flush=True)

    scenes = several(parameter_file.parameters_of(json.loads(sys.stdin.readline())))
    threading.Thread(target=_end_with_the_node, daemon=True).start()
    total = jit.reached_from(kernels({choose_method(scene) for scene in scenes.values()}))
    write([0, total])
    try:
        with jit.watched(lambda count, _: write([min(count, total), total])):
            compile_kernels(scenes)
    except CylconnError as error:
        print(error, file=sys.stderr)
        return 1
    write(_DONE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
