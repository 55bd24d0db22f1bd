"""The supervisor of child processes: output, JSON lines, signals, the end, and environments."""

import signal
import sys
import time
from pathlib import Path

import pytest

from cylconn_ros.errors import CommandError, ProcessError
from cylconn_ros.process import child
from cylconn_ros.process.child import Child

TIMEOUT = 20.0  # s


def python(code: str) -> list[str]:
    return [sys.executable, "-u", "-c", code]


def start(code: str, **options) -> Child:
    return Child("child", python(code), child.private_environment(), **options)


def test_output_is_read_by_line_and_the_process_ends_on_an_interrupt() -> None:
    consumed = []

    def on_line(line: str) -> bool:
        consumed.append(line)
        return line.startswith("progress")

    code = "import time; print('progress 1 2'); print('words'); time.sleep(60)"
    with start(code, on_line=on_line) as running:
        assert running.wait_for("words", TIMEOUT) == "words"
        assert consumed == ["progress 1 2", "words"]
        assert running.running
        assert running.exit_code is None
        assert list(running.lines) == ["words"]
        begin = time.monotonic()
    assert running.exit_code is not None
    assert time.monotonic() - begin < TIMEOUT


def test_a_process_that_ignores_signals_is_killed() -> None:
    code = (
        "import signal, time\n"
        "for s in (signal.SIGINT, signal.SIGTERM): signal.signal(s, signal.SIG_IGN)\n"
        "print('started'); time.sleep(60)"
    )
    running = start(code)
    running.wait_for("started", TIMEOUT)
    assert running.finish(patience=0.2) == -signal.SIGKILL
    assert running.last_words() == "last output of child:\n    started"


def test_a_child_can_be_interrupted_if_this_process_ignores_interrupts() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with start("import signal; print(signal.getsignal(signal.SIGINT))") as running:
            assert "default_int_handler" in running.wait_for("", TIMEOUT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_waiting_for_a_line_that_never_appears() -> None:
    with (
        start("import time; print('one'); time.sleep(60)") as running,
        pytest.raises(TimeoutError, match=r"child: no line with 'two' within 0\.2 s"),
    ):
        running.wait_for("two", 0.2)
    with (
        start("print('one')") as running,
        pytest.raises(ProcessError, match="child ended with exit code 0: one"),
    ):
        running.wait_for("two", TIMEOUT)


def test_requests_and_responses_are_json_lines() -> None:
    code = (
        "import json, sys\n"
        "print('text', file=sys.stderr)\n"
        "for line in sys.stdin: print(json.dumps(2 * json.loads(line)))"
    )
    with start(code, json_lines=True) as running:
        assert running.request(21, TIMEOUT) == 42
        assert running.request([1], TIMEOUT) == [1, 1]
        with pytest.raises(TimeoutError):
            running.read(0.1)
    assert running.exit_code == 0  # the end of its input ends it
    assert running.output == "text"
    with pytest.raises(ProcessError, match="child ended with exit code 0: text"):
        running.request(1)


def test_messages_end_with_the_output_or_with_the_reason() -> None:
    with start("print(1); print([2])", json_lines=True) as running:
        assert list(running.messages()) == [1, [2]]
    with start("print(1); import sys; sys.exit('no disk')", json_lines=True) as running:
        found = running.messages()
        assert next(found) == 1
        with pytest.raises(ProcessError, match="child ended with exit code 1: no disk"):
            next(found)
    with (
        start("print('no JSON')", json_lines=True) as running,
        pytest.raises(ProcessError, match="child wrote a line that is not JSON: no JSON"),
    ):
        running.read(TIMEOUT)


def test_a_paused_process_continues() -> None:
    code = "import sys\nfor line in sys.stdin: print(line, end='')"
    with start(code, json_lines=True) as running:
        assert running.request(1, TIMEOUT) == 1
        with running.paused():
            running.write(2)
            with pytest.raises(TimeoutError):
                running.read(0.3)
        assert running.read(TIMEOUT) == 2
        assert 1.0 < running.resident_memory < 1000.0
        assert 0.0 < running.cpu_time < TIMEOUT
        running.kill()
        assert running.exit_code == -signal.SIGKILL
        assert not running.running


def test_the_child_does_not_inherit_the_prepared_ros_libraries(tmp_path: Path) -> None:
    environment = {**child.private_environment(), "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}
    code = "import os; print(os.environ.get('_ROS_WHEELS_BOOTSTRAP_COMPLETE')); print(os.getcwd())"
    command = [sys.executable, "-I", "-S", "-u", "-c", code]
    with Child("child", command, environment, folder=tmp_path) as running:
        running.wait_for(str(tmp_path), TIMEOUT)
        assert list(running.lines) == ["None", str(tmp_path)]


def test_a_command_that_cannot_be_started() -> None:
    with pytest.raises(ProcessError, match=r"ghost cannot be started: .*no_such_file"):
        Child("ghost", ["./no_such_file"], {})


def test_programs_are_found_beside_the_running_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "plant"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "cylconn"), "demo"])
    assert child.executable("plant") == program
    with pytest.raises(CommandError, match="no_such_program is not installed"):
        child.executable("no_such_program")


def test_private_environments_are_isolated() -> None:
    environment = child.private_environment()
    profile = Path(environment["FASTRTPS_DEFAULT_PROFILES_FILE"]).read_text()
    assert "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>" in profile
    assert 0 < int(environment["ROS_DOMAIN_ID"]) < 100
