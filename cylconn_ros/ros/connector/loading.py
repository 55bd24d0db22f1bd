"""Load the kernels of a node; compile those that are missing while the node runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rclpy.clock import Clock
from rclpy.lifecycle import LifecycleNode

from cylconn_ros.core.kernel_cache import NotCompiledError, only_stored
from cylconn_ros.ros.compiling import Compilation
from cylconn_ros.ros.connector.endpoint import ConnectorEndpoint
from cylconn_ros.ros.connector.held_messages import HeldMessages
from cylconn_ros.ros.connector.shared_bodies import couple_connectors
from cylconn_ros.ros.executor.executor import InputGroup, SampleExecutor, merge_groups
from cylconn_ros.scene.scene import Scene

_POLL = 0.1  # s between looks at the child process
_REPORT = 5.0  # s between lines in the log


class Samples(NamedTuple):
    """What processes the samples of a node: its groups of connectors, their executor and lock."""

    groups: Sequence[Sequence[ConnectorEndpoint]]
    executor: SampleExecutor | None
    lock: Any
    held: HeldMessages

    def not_processed(self) -> str:
        """Text about the samples that wait for the compilation; '' if none has arrived."""
        samples = sum(one.not_processed for group in self.groups for one in group)
        dropped = self.held.dropped
        lost = f" ({dropped} messages are too old and will not be)" if dropped else ""
        return f"; {samples} samples not yet processed{lost}" if samples else ""

    def begin(self) -> None:
        """Process the messages that were held, and from now on those that arrive."""
        if not self.held.active:
            return
        opened = any(one.is_open for group in self.groups for one in group)
        if self.executor is not None and opened:
            self.executor.close()
        with self.lock:
            for receive, data in self.held.release():
                receive(data)
        if self.executor is not None and opened:
            self.executor.open(input_groups(self.groups))


def input_groups(groups: Sequence[Sequence[ConnectorEndpoint]]) -> list[InputGroup]:
    """The open subscriptions, in groups whose messages form samples together."""
    return [merge_groups([one.input_group() for one in group]) for group in groups]


class KernelLoader:
    """Load kernels without blocking the node: what the cache lacks is compiled by a child process.

    If the child process fails, or what it compiles cannot be loaded, this process compiles.
    """

    def __init__(
        self,
        node: LifecycleNode,
        clock: Clock,
        samples: Samples,
        scenes: Callable[[], Mapping[str, Scene]],
        put_in_force: Callable[[], None],
    ) -> None:
        """Functions: ``scenes`` returns the scenes in force or to be in force.

        ``put_in_force`` is called when compiled kernels have been loaded.
        """
        self._node, self._clock, self._samples = node, clock, samples
        self._scenes, self._put_in_force = scenes, put_in_force
        self._compilation: Compilation | None = None
        self._timer: Any = None
        self._begin = self._reported = 0.0

    @property
    def progress(self) -> str:
        """How far the compilation is; '' if nothing is being compiled."""
        one = self._compilation
        return "" if one is None else f"{one.done} of {one.total} functions"

    def load(self) -> bool:
        """Load all kernels from the cache; if some are missing, begin to compile: False."""
        try:
            with only_stored():
                self._load()
        except NotCompiledError:
            if self._compilation is None:
                self._start()
            return False
        self.close()
        return True

    def _start(self) -> None:
        self._compilation = Compilation(self._scenes())
        self._node.get_logger().info(
            "compiling the physics, once: takes half a minute or more; later starts use the cache. "
            "Services answer meanwhile; samples are kept and processed afterwards"
        )
        self._begin = self._reported = time.monotonic()
        self._timer = self._node.create_timer(_POLL, self._poll, clock=self._clock)

    def _poll(self) -> None:
        one = self._compilation
        if one is None:
            return
        one.poll()
        now = time.monotonic()
        logger = self._node.get_logger()
        if not one.ended:
            if now >= self._reported + _REPORT:
                self._reported = now
                logger.info(
                    f"compiling the physics: {self.progress}{self._samples.not_processed()}"
                )
            return
        self.close()
        if one.failure:
            logger.error(
                f"{one.failure}; compiling in this process: services do not answer meanwhile"
            )
            self._load()
        elif not self._load_compiled(one):
            return
        seconds = time.monotonic() - self._begin
        logger.info(f"compiled in {seconds:.1f} s{self._samples.not_processed()}")
        self._put_in_force()
        self._samples.begin()

    def _load(self) -> None:
        """Load all kernels; raises NotCompiledError if some are missing and may not be compiled."""
        for group in self._samples.groups:
            for connector in group:
                connector.load_kernels()
            if any(one.coupled is None for one in group):
                text = couple_connectors(group)
                if text:
                    self._node.get_logger().info(text)

    def drop_samples(self) -> None:
        """Drop the samples that wait, with a line in the log."""
        text = self._samples.not_processed()
        if text:
            self._node.get_logger().warning(f"deactivated while compiling{text}")
        self._samples.held.clear()

    def _load_compiled(self, compiled: Compilation) -> bool:
        """Load what was compiled; False if the scenes have changed and need more."""
        try:
            with only_stored():
                self._load()
        except NotCompiledError:
            if compiled.scenes != self._scenes():
                self._start()
                return False
            self._node.get_logger().error(
                "compiled code cannot be loaded from the cache; compiling in this process: "
                "services do not answer meanwhile"
            )
            self._load()
        return True

    def close(self) -> None:
        """End a compilation."""
        if self._compilation is not None:
            self._compilation.close()
            self._compilation = None
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None
