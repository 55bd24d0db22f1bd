"""Recording node: killed, disk full, no permission; samples are processed in any case."""

import signal
import sys
import time

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from ros_processes import Listener, Source, parameters, program, stamp_of
from rosbags.rosbag2 import Reader
from std_srvs.srv import Trigger

from cylconn_ros.cli import main
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.salvage import salvage

MS = 1_000_000
LATEST = 0.3  # s before its end that a killed node may lose on a busy machine; 0.1 on an idle one


def exchange(peer, listener, source, seconds):
    """Send about 200 samples per second; return the arrival time of each wrench by stamp (s)."""
    arrivals: dict[int, float] = {}
    sent = 5 * MS
    end = time.time() + seconds
    while time.time() < end:
        sent += MS
        source.send(sent)
        peer.spin_for(0.005)
        now = time.time()
        for wrench in listener.b:
            arrivals.setdefault(stamp_of(wrench), now)
    return arrivals


def test_salvage_recovers_a_run_after_kill_9_except_its_end(connector, peer, tmp_path, capsys):
    with connector("record.enabled:=true", "timeout:=.inf") as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 5 * MS)
        arrivals = exchange(peer, listener, source, 1.5)
        killed = time.time()
        running.kill()
    (run,) = (tmp_path / "runs").iterdir()
    assert not (run / "metadata.yaml").exists()
    assert main.main(["info", str(run)]) == 1
    assert "INCOMPLETE: never finished" in (shown := capsys.readouterr().out)
    assert "cylconn salvage recovers" in shown

    assert main.main(["salvage", str(run)]) == 0
    printed = capsys.readouterr().out.splitlines()
    saved = run.with_name(f"{run.name}_salvaged")
    whole = read_run(saved)
    assert whole.incomplete is None
    messages = sum(whole.counts.values())
    assert printed[1].startswith(
        f"recovered {messages} messages over {whole.duration:.3f} s in {saved}"
    )
    recorded = {int(stamp) for stamp in whole.table("/body_b/wrench").stamp}
    expected = {stamp for stamp, when in arrivals.items() if when < killed - LATEST}
    assert len(expected) > 20
    assert expected <= recorded
    assert whole.parameters["record.enabled"] is True
    with Reader(saved) as reader:  # not the reader of this package
        assert reader.message_count == messages
    assert main.main(["salvage", str(saved)]) == 2
    assert "is complete: nothing to salvage" in capsys.readouterr().err


WITHOUT_PACKAGES = """
import sys
sys.modules.update(dict.fromkeys(("mcap", "zstandard", "lz4", "bokeh")))  # their imports fail
from cylconn_ros.ros.connector import node as connector_node
raise SystemExit(connector_node.main())
"""


@pytest.mark.parametrize("enabled", ["false", "true"])
def test_without_its_packages_the_node_runs_and_does_not_record(peer, tmp_path, enabled):
    rules = parameters(f"record.enabled:={enabled}", "timeout:=.inf")
    with program([sys.executable, "-c", WITHOUT_PACKAGES, *rules], tmp_path) as running:
        listener, source = Listener(peer), Source(peer)
        assert listener.exchange(source, 5 * MS)
        reason = "cannot record: needs the package zstandard: pip install mcap zstandard"
        if enabled == "true":
            listener.wait_for_status("recording", reason)
        assert listener.exchange(source, 9 * MS)
        assert running.stop() == 0, running.output
        assert (reason in running.output) == (enabled == "true")
        assert "Traceback" not in running.output


LIMITED = """
import resource
from cylconn_ros.ros.connector import node as connector_node
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
raise SystemExit(connector_node.main())
"""


def test_full_disk_is_diagnosed_and_samples_continue(peer, tmp_path):
    """A limit of the file size in place of a full disk: the operating system raises the error."""
    rules = parameters("record.enabled:=true", "timeout:=.inf", "record.compression:=none")
    with program([sys.executable, "-c", LIMITED, *rules], tmp_path) as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 5 * MS)
        exchange(peer, listener, source, 1.0)
        listener.wait_for_status("recording", "recording failed: ")
        peer.spin_until(lambda: int(listener.status("recording")[2]["messages lost"]) > 0)
        level, text, _ = listener.status("recording")
        assert "_0.mcap: File too large" in text
        assert level == 2
        assert listener.exchange(source, 9000 * MS)
        assert running.stop() == 0, running.output
        assert "Traceback" not in running.output
    (run,) = (tmp_path / "runs").iterdir()
    assert "File too large" in str(read_run(run).incomplete)  # its end could not be written
    assert read_run(salvage(run).directory).counts["/body_b/wrench"] > 10


def test_node_runs_without_recording_if_the_directory_cannot_be_written(connector, peer, tmp_path):
    (tmp_path / "taken").write_text("a file")
    with connector("record.enabled:=true", "record.directory:=taken", "timeout:=.inf") as running:
        listener, source = Listener(peer), Source(peer)
        assert listener.exchange(source, 5 * MS)
        running.wait_for("[ERROR]")
        listener.wait_for_status("recording", "recording failed: cannot record: ")
        assert "Not a directory; running without a recording" in running.output
        response = peer.call(Trigger, "/connector/start_recording")
        assert not response.success
        assert "cannot record: " in response.message
        assert running.stop() == 0


@pytest.mark.parametrize("link", [False, True])
def test_recording_is_refused_outside_the_permitted_directory(connector, peer, tmp_path, link):
    def put(directory):
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=str(directory))
        request = SetParameters.Request(
            parameters=[Parameter(name="record.directory", value=value)]
        )
        return peer.call(SetParameters, "/connector/set_parameters", request).results[0]

    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "link").symlink_to(tmp_path)
    elsewhere = "kept/link" if link else f"{tmp_path}/kept/../elsewhere"
    with connector("record.directory:=kept", "timeout:=.inf") as running:
        result = put(elsewhere)
        assert not result.successful
        assert result.reason == (
            f"record.directory = '{elsewhere}': must be {tmp_path}/kept, which was given when the "
            "node started, or below it"
        )
        assert put("kept/below").successful
        response = peer.call(Trigger, "/connector/start_recording")
        assert response.message.startswith(f"recording to {tmp_path}/kept/below/connector_")
        assert running.stop(signal.SIGTERM) == 0
