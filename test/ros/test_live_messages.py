"""Messages of the programs: each warning or error names the cause and the remedy."""

import subprocess
import sys
import time

import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from ros_processes import Listener, installed, parameters, program

import cylconn_ros
from cylconn_ros.cli.scenes import bundled
from cylconn_ros.scene.scene import load, shipped

MS = 1_000_000

# An exception raised within a callback of the compiler would be lost in a traceback.
COMPILING = """
import signal, sys
from cylconn_ros.process.interrupt import interruptible
with interruptible("program"):
    import numba
    @numba.njit
    def slow(x):
        return x
    inner = numba.core.compiler.CompilerBase._compile_core
    def interrupted(self):
        signal.raise_signal(signal.SIGINT)
        return inner(self)
    numba.core.compiler.CompilerBase._compile_core = interrupted
    slow(1.0)
print("went on")
"""


def test_ctrl_c_while_compiling_prints_one_line():
    done = subprocess.run([sys.executable, "-c", COMPILING], capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stdout == ""
    assert done.stderr == "\nprogram: interrupted while compiling; the next start compiles again\n"


def test_ctrl_c_ends_a_command_that_compiles(tmp_path, monkeypatch):
    monkeypatch.setenv("CYLCONN_CACHE_DIR", str(tmp_path / "cache"))
    command = [sys.executable, "-m", "cylconn_ros.cli.main", "simulate", "coast"]
    with program(command, tmp_path) as running:
        running.wait_for("simulate coast: ")
        time.sleep(3.0)  # well into compiling, which takes many times as long
        assert running.stop() == 130, running.output
        assert "Traceback" not in running.output
        assert running.lines[-1].endswith(
            "interrupted while compiling; the next start compiles again"
        )


def test_warning_about_stamp_offsets_names_the_parameter(connector, peer):
    with connector("timeout:=.inf", "period:=0.01") as running:
        create = peer.node.create_publisher
        pose, twist = (
            create(PoseStamped, "/body_b/pose", 50),
            create(TwistStamped, "/body_b/twist", 50),
        )
        peer.spin_until(lambda: pose.get_subscription_count() and twist.get_subscription_count())

        def warnings():
            for publisher, message, stamp in (
                (pose, PoseStamped(), 10 * MS),
                (twist, TwistStamped(), 10 * MS + 500),
            ):
                message.header.stamp.nanosec = stamp
                publisher.publish(message)
            peer.spin_for(0.1)
            return [line for line in running.lines if "no complete sample" in line]

        line = peer.spin_until(warnings, "a warning about the stamps")[0]
        assert "received: body_b/pose " in line
        assert line.endswith(
            "their stamps differ by at least 5e-07 s; set stamp_tolerance (now 0 s) above that"
        )


def test_plant_ends_with_one_line_if_its_motion_is_not_finite(peer, installed_prefix, tmp_path):
    publisher = peer.node.create_publisher(WrenchStamped, "/body_b/wrench", 50)
    poses = peer.collect(PoseStamped, "/body_b/pose")
    peer.collect(TwistStamped, "/body_b/twist")
    with program([*installed(installed_prefix, "plant"), *parameters()], tmp_path) as moving:
        peer.spin_until(lambda: poses, "the first sample")
        message = WrenchStamped()
        message.wrench.force.x = float("inf")
        publisher.publish(message)
        assert moving.wait() == 1, moving.output
    text = "plant: the motion is not finite at 0.001 s, after the wrenches [0, 0, 0, 0, 0, 0] on A "
    assert any(line.startswith(text + "and [inf, 0, ") for line in moving.lines), moving.output
    assert "Traceback" not in moving.output


def test_changed_parameters_are_logged(connector, peer):
    with connector("timeout:=.inf") as running:
        Listener(peer)
        mass = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=3.0)
        request = SetParameters.Request(parameters=[Parameter(name="body_b.mass", value=mass)])
        assert peer.call(SetParameters, "/connector/set_parameters", request).results[0].successful
        peer.spin_until(lambda: "parameters changed: body_b.mass: 2.0 -> 3.0" in running.output)
        names = ["command.slide.position", "command.spin.velocity"]
        request = DescribeParameters.Request(names=names)
        found = peer.call(DescribeParameters, "/connector/describe_parameters", request)
        units = [d.description.rpartition(" ")[2] for d in found.descriptors]
        assert units == ["[m]", "[rad/s]"]


@pytest.mark.parametrize("name", ["connector", "plant"])
def test_parameter_file_of_another_node_is_reported(name, installed_prefix, tmp_path):
    (tmp_path / "other.yaml").write_text("arm: {ros__parameters: {period: 0.002}}")
    file = ["--ros-args", "--params-file", "other.yaml"]
    why = f"other.yaml: has parameters for /arm, but none for /{name} (nor for /**)"
    command = installed(installed_prefix, name)
    with program([*command, *file], tmp_path) as running:
        assert running.wait() == 2
        assert running.output.startswith(f"{name}: node_a.orientation: is required")
        assert running.output.endswith(f"; {why}")
    with program([*command, "--version"], tmp_path) as running:
        assert running.wait() == 0
        assert running.output == cylconn_ros.__version__


def test_shipped_scenes_are_found_by_name():
    assert load(shipped("demo")) == load(bundled()["demo"])
    with pytest.raises(ValueError, match="nowhere: no bundled scene; there are bead_on"):
        shipped("nowhere")
