"""What the programs say when something is off, so that nobody has to guess."""

import subprocess
import sys
import time

import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from ros_processes import Listener, installed, module, parameters, program

import cylconn_ros
from cylconn_ros.cli.scenes import bundled
from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.ros.connector.incomplete import PATIENCE, Waiting
from cylconn_ros.scene.scene import Scene, load, shipped

MS = 1_000_000
SCENE = {
    "node_a.orientation": [0, 0, 0, 1],
    "body_b.mass": 2.0,
    "body_b.inertia": [1, 0, 0, 1, 0, 1],
}

# The compiler's callbacks are where an exception would be lost in a traceback.
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


def test_ctrl_c_while_compiling_is_one_line():
    done = subprocess.run([sys.executable, "-c", COMPILING], capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stdout == ""
    assert done.stderr == "\nprogram: interrupted while compiling; the next start begins anew\n"


@pytest.mark.parametrize(
    ("command", "beginning"),
    [
        ([*module("connector.node"), *parameters()], "[INFO]"),
        ([sys.executable, "-m", "cylconn_ros.cli.main", "simulate", "coast"], "simulate coast: "),
    ],
)
def test_programs_that_compile_end_on_ctrl_c(command, beginning, tmp_path, monkeypatch):
    monkeypatch.setenv("CYLCONN_CACHE_DIR", str(tmp_path / "cache"))
    with program(command, tmp_path) as running:
        running.wait_for(beginning)
        time.sleep(3.0)  # well into compiling, which takes many times as long
        assert running.stop() == 130, running.output
        assert "Traceback" not in running.output
        assert running.lines[-1].endswith("interrupted while compiling; the next start begins anew")


def test_stamps_that_never_meet_are_told_with_the_parameter_to_set(connector, peer):
    with connector("timeout:=.inf", "period:=0.01") as running:
        create = peer.node.create_publisher
        pose, twist = (
            create(PoseStamped, "/body_b/pose", 50),
            create(TwistStamped, "/body_b/twist", 50),
        )
        peer.spin_until(lambda: pose.get_subscription_count() and twist.get_subscription_count())

        def told():
            for publisher, message, stamp in (
                (pose, PoseStamped(), 10 * MS),
                (twist, TwistStamped(), 10 * MS + 500),
            ):
                message.header.stamp.nanosec = stamp
                publisher.publish(message)
            peer.spin_for(0.1)
            return [line for line in running.lines if "no complete sample" in line]

        line = peer.spin_until(told, "a word about the stamps")[0]
        assert "messages: body_b/pose " in line
        assert line.endswith(
            "their stamps are at least 5e-07 s apart: set stamp_tolerance, now 0 s, "
            "to more than that"
        )


def words(feed, seconds=3.0, **rules):
    """What is said while ``feed(matcher, k)`` is called fifty times a second."""
    scene = Scene.from_parameters({**SCENE, **rules})
    matcher, waiting = SampleMatcher(scene), Waiting()
    said = []
    for k in range(round(50 * seconds)):
        feed(matcher, k)
        said.append(waiting.look(matcher, scene, 0.02 * k))
    return [text for text in said if text]


def pose(matcher, stamp):
    matcher.pose(1, stamp, "world", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))


def twist(matcher, stamp):
    matcher.twist(1, stamp, "world", (0.0,) * 6)


def test_nothing_is_said_of_samples_that_complete_or_of_silence():
    def both(matcher, k):
        pose(matcher, k * MS)
        twist(matcher, k * MS)

    assert words(both) == []
    assert words(lambda *_: None) == []


def test_what_is_said_names_the_cause():
    def apart(by):
        def feed(matcher, k):
            pose(matcher, 10 * k * MS)
            twist(matcher, 10 * k * MS + by)

        return feed

    count = round(50 * PATIENCE) + 1
    told = f"no complete sample in 2 s; messages: body_b/pose {count}"
    both = f"{told}, body_b/twist {count}; their stamps are at least "
    assert words(lambda m, k: pose(m, k * MS)) == [f"{told}; nothing on body_b/twist"]
    assert words(apart(500), period=0.01) == [
        f"{both}5e-07 s apart: set stamp_tolerance, now 0 s, to more than that"
    ]
    assert words(apart(5 * MS), period=0.01) == [
        f"{both}0.005 s apart, half a period or more: pose and twist of a sample must carry one "
        "stamp"
    ]
    assert words(apart(500), period=0.01, stamp_tolerance=1e-6) == []
    assert len(words(apart(500), seconds=40.0, period=0.01)) == 2


def test_a_plant_whose_motion_is_not_finite_ends_with_a_plain_line(
    peer, installed_prefix, tmp_path
):
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


def test_a_change_of_parameters_is_logged_with_what_changed(connector, peer):
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
def test_a_file_for_another_node_is_said_to_be_one(name, installed_prefix, tmp_path):
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
    with pytest.raises(ValueError, match="nowhere: no scene of this package; there are bead_on"):
        shipped("nowhere")
