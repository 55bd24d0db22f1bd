"""Mutated recordings, metadata and parameter files: one sentence that names the file."""

from __future__ import annotations

import os
import resource
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import any_bags
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin

from cylconn_ros.cli.main import main
from cylconn_ros.errors import CylconnError, SceneError
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.salvage import salvage
from cylconn_ros.scene.parameter_file import load_parameters

SHORT = settings(
    max_examples=int(os.environ.get("FUZZ_EXAMPLES", "25")),
    deadline=10_000,  # ms: nothing hangs
    suppress_health_check=list(HealthCheck),
)
CHANGES = st.lists(
    st.tuples(st.sampled_from(["flip", "byte", "cut", "insert", "zero", "ones"]),
              st.floats(0.0, 1.0), st.integers(0, 255)),
    min_size=1, max_size=4,
)  # fmt: skip
ROWS = any_bags.motion()[:200]


def mutated(data: bytes, changes: list[tuple[str, float, int]]) -> bytes:
    found = bytearray(data)
    for kind, share, value in changes:
        at = min(int(share * len(found)), max(len(found) - 1, 0))
        if kind == "flip" and found:
            found[at] ^= 1 << (value % 8)
        elif kind == "byte" and found:
            found[at] = value
        elif kind == "cut":
            del found[at : len(found) if value % 2 else at + value]
        elif kind == "insert":
            found[at:at] = bytes([value]) * (value % 16 + 1)
        else:  # lengths become zero or huge
            found[at : at + 8] = (b"\0" if kind == "zero" else b"\xff") * 8
    return bytes(found)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Intact files: chunks of a few messages each."""
    place = tmp_path_factory.mktemp("intact")
    plain = any_bags.mcap(place / "zstd.mcap", ROWS, chunk=1500)
    database = any_bags.rosbags(place / "db", ROWS, StoragePlugin.SQLITE3)
    packed = place / "packed.mcap.zstd"
    packed.write_bytes(zstandard.compress(plain.read_bytes()))
    return {
        "zstd": plain,
        "unchunked": any_bags.mcap(place / "unchunked.mcap", ROWS, use_chunking=False),
        "messages": any_bags.mcap(
            place / "messages.mcap", [(t, k, zstandard.compress(d)) for t, k, d in ROWS]
        ),
        "db3": next(database.glob("*.db3")),
        "packed": packed,
    }


def use(path: Path) -> None:
    """What the commands do with a recording; only errors of the package, which name the file."""
    target = path.parent / "recovered"
    for action in (
        lambda: sum(1 for _ in Bag(path).messages()),
        lambda: [read_run(path).table(t) for t in read_run(path).types if "body" in t],
        lambda: salvage(path, target),
    ):
        try:
            action()
        except CylconnError as error:
            text = str(error)
        else:
            continue
        assert str(path) in text or "/body_b" in text, text
        assert "\n" not in text
    shutil.rmtree(target, ignore_errors=True)


@pytest.mark.parametrize("kind", ["zstd", "unchunked", "messages", "db3", "packed"])
def test_mutated_recordings(
    kind: str, sources: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    source = sources[kind]
    data, place = source.read_bytes(), tmp_path_factory.mktemp(kind) / source.name

    @SHORT
    @given(CHANGES)
    def check(changes: list[tuple[str, float, int]]) -> None:
        place.write_bytes(mutated(data, changes))
        use(place)

    check()


def test_salvage_keeps_every_intact_chunk(
    sources: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Wherever a byte is wrong, the messages of all other chunks are there."""
    data, place = sources["zstd"].read_bytes(), tmp_path_factory.mktemp("one") / "one.mcap"
    with sources["zstd"].open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = summary.chunk_indexes
    assert len(chunks) > 10
    ends = [(c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in chunks]

    @settings(SHORT, max_examples=4 * SHORT.max_examples)
    @given(st.integers(0, len(data) - 1), st.integers(1, 255))
    def check(at: int, value: int) -> None:
        broken = bytearray(data)
        broken[at] ^= value
        place.write_bytes(broken)
        found = {(m.topic, m.log_time, m.data) for m in Bag(place).messages()}
        intact = [c for c, (begin, end) in zip(chunks, ends, strict=True) if not begin <= at < end]
        times = [(c.message_start_time, c.message_end_time) for c in intact]
        for row in ROWS:
            if any(begin <= row[1] <= end for begin, end in times):
                assert row in found

    check()


META = """rosbag2_bagfile_information:
  version: 9
  relative_file_paths: [zstd.mcap]
  custom_data: {a: b}
  topics_with_message_count: [{topic_metadata: {name: /x, type: y}, message_count: 3}]
"""
YAML = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
    | st.just(10**300),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)  # fmt: skip


def test_mutated_metadata(
    sources: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    import yaml

    directory = tmp_path_factory.mktemp("metadata")
    shutil.copy(sources["zstd"], directory / "zstd.mcap")
    keys = list(yaml.safe_load(META)["rosbag2_bagfile_information"])

    @SHORT
    @given(st.one_of(
        CHANGES.map(lambda c: mutated(META.encode(), c)),
        st.tuples(st.sampled_from(keys), YAML).map(
            lambda kv: yaml.safe_dump({"rosbag2_bagfile_information": {
                **yaml.safe_load(META)["rosbag2_bagfile_information"], kv[0]: kv[1]}}).encode()
        ),
    ))  # fmt: skip
    def check(text: bytes) -> None:
        (directory / "metadata.yaml").write_bytes(text)
        use(directory)

    check()


PARAMETERS = """/**:
  ros__parameters:
    period: 0.001
    node_a: {orientation: [0, 0, 0, 1]}
    body_b: {kind: free, mass: 2.0, inertia: [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]}
    friction: {coefficient: 0.2, radius: 0.02}
"""


def test_mutated_parameter_files(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("parameters") / "scene.yaml"

    @settings(SHORT, max_examples=4 * SHORT.max_examples)
    @given(CHANGES)
    def check(changes: list[tuple[str, float, int]]) -> None:
        path.write_bytes(mutated(PARAMETERS.encode(), changes))
        try:
            load_parameters(path, "connector")
        except SceneError as error:
            text = str(error)
        else:
            return
        assert str(path) in text

    check()


def nested(depth: int) -> str:
    return "x: " + "{a: " * depth + "1" + "}" * depth


LEVELS = "\n".join(
    f"    x{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" if k else "    x0: &a0 [1, 2, 3]"
    for k in range(9)
)
BAD_PARAMETERS = {
    "alias bomb": (f"/**:\n  ros__parameters:\n{LEVELS}\n", "values"),
    "contains itself": ("/**: &a\n  ros__parameters:\n    body_b: *a\n", "contains it"),
    "deep": (f"/**:\n  ros__parameters:\n    {nested(5000)}\n", "levels of nesting"),
    "huge integer": (f"/**:\n  ros__parameters:\n    timeout: {'9' * 5000}\n", "not a valid int"),
    "no date": ("/**:\n  ros__parameters:\n    world_frame: 2020-13-45\n", "not a valid timestamp"),
    "long text": (f"/**:\n  ros__parameters:\n    mu: {'x' * 4_000_000}\n", "(4000000 characters)"),
    "large file": (f"/**:\n  ros__parameters:\n    mu: {'x' * 5_000_000}\n", "more than"),
    "huge period": (PARAMETERS.replace("0.001", "1e300"), "period"),
}


@pytest.mark.parametrize("name", BAD_PARAMETERS)
def test_parameter_files_that_no_node_can_use(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, reason = BAD_PARAMETERS[name]
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    began = time.monotonic()
    assert main(["simulate", str(path), "--duration", "0.01"]) == 2
    assert time.monotonic() - began < 10.0
    error = capsys.readouterr().err
    assert str(path) in error
    assert reason in error
    assert len(error.strip().splitlines()[-1]) < 800


def test_pipes_are_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    for command in (["info"], ["salvage"], ["replay"], ["identify"], ["report"]):
        assert main([*command, str(tmp_path / "pipe.mcap")]) == 2
        assert "pipe.mcap: is not a regular file" in capsys.readouterr().err


OTHERS = {
    "x.bag": (b"#ROSBAG V2.0\n" + bytes(100), "rosbags-convert"),
    "x.mcap": (b"", "it is empty"),
    "x.zip": (b"PK\x03\x04" + bytes(50), "unpack it with unzip"),
    "x.mcap.gz": (b"\x1f\x8b" + bytes(50), "unpack it with gunzip"),
    "x.db3": (b"SQLite format 3\0" + bytes(80), "x.db3"),
    "x.txt": (b"time,position\n", "is not a recording"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_formats_are_named(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, text = OTHERS[name]
    (tmp_path / name).write_bytes(content)
    for command in ("info", "salvage", "replay", "identify", "report"):
        assert main([command, str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert text in error
        assert str(tmp_path / name) in error


def bomb(size: int) -> Callable[[bytes], bytes]:
    """A zstd frame of ``size`` zeros, made piece by piece."""
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    piece = bytes(1 << 20)
    packed = b"".join(compressor.compress(piece) for _ in range(size >> 20))
    return lambda _: packed + compressor.flush()


def test_bombs_take_little_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bomb.mcap.zstd"
    path.write_bytes(bomb(1 << 30)(b""))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert main(["info", str(path)]) == 2
    assert "expands to more than" in capsys.readouterr().err
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert after - before < 300_000  # KiB
