"""Recordings for an archive: the golden ones with noise on their twists, replayed.

``python test/study/noisy_bags.py FOLDER COUNT`` makes as many.
"""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path

import numpy as np

from cylconn_ros.cli.main import main
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.writer import RunWriter

GOLDEN = Path(__file__).parents[2] / "bags"
NOISE = 1e-5  # m/s and rad/s


def noisy(source: Path, target: Path, seed: int) -> None:
    """Write a replay of ``source`` whose recorded twists have normal noise."""
    generator, bag = np.random.default_rng(seed), Bag(source)
    inputs = target.with_name(f"{target.name}_inputs")
    topics = [TopicInfo(topic, kind) for topic, kind in bag.types.items()]
    with RunWriter(inputs, topics, bag.metadata, "zstd") as writer:
        for topic, log_time, data in bag.messages():
            if bag.types[topic] == "geometry_msgs/msg/TwistStamped" and len(data) > 48:
                twist = np.frombuffer(data[-48:], np.float64) + NOISE * generator.normal(size=6)
                data = data[:-48] + twist.tobytes()
            writer.write(topic, data, log_time, log_time)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert main(["replay", str(inputs), "-o", str(target)]) == 0
    for file in inputs.iterdir():
        file.unlink()
    inputs.rmdir()


def make(folder: Path, count: int) -> None:
    """Make ``count`` recordings, of each golden one in turn."""
    sources = sorted(path for path in GOLDEN.iterdir() if path.is_dir())
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        source = sources[k % len(sources)]
        noisy(source, folder / f"{source.name}_{k:04d}", k)


if __name__ == "__main__":
    make(Path(sys.argv[1]), int(sys.argv[2]))
