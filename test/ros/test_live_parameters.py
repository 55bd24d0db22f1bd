"""Parameters of a running connector as ROS tools set them: dump and load, types, not set."""

from pathlib import Path

import pytest
import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python
from ros_processes import installed, program


class Tool:
    """The requests of ros2 param."""

    def __init__(self, peer) -> None:
        self.peer = peer

    def get(self, *names):
        request = GetParameters.Request(names=list(names))
        return self.peer.call(GetParameters, "/connector/get_parameters", request).values

    def set(self, *parameters):
        request = SetParameters.Request(parameters=list(parameters))
        return self.peer.call(SetParameters, "/connector/set_parameters", request).results

    def names(self):
        found = self.peer.call(ListParameters, "/connector/list_parameters").result.names
        return sorted(found)

    def dump(self, path: Path) -> None:
        """Write what ros2 param dump prints."""
        names = self.names()
        tree: dict = {}
        for name, value in zip(names, self.get(*names), strict=True):
            *groups, last = name.split(".")
            block = tree
            for group in groups:
                block = block.setdefault(group, {})
            block[last] = parameter_value_to_python(value)
        document = {"/connector": {"ros__parameters": tree}}
        path.write_text(yaml.dump(document, default_flow_style=False))

    def load(self, path: Path):
        """The reasons of the refusals of ros2 param load."""
        messages = list(parameter_dict_from_yaml_file(str(path)).values())
        results = self.set(*messages)
        return [(m.name, r.reason) for m, r in zip(messages, results, strict=True) if r.reason]


def number(name: str, value: float) -> Parameter:
    kind = ParameterType.PARAMETER_DOUBLE
    return Parameter(name=name, value=ParameterValue(type=kind, double_value=value))


def whole(name: str, value: int) -> Parameter:
    kind = ParameterType.PARAMETER_INTEGER
    return Parameter(name=name, value=ParameterValue(type=kind, integer_value=value))


def test_dump_and_load_change_and_refuse_nothing(connector, peer, installed_prefix, tmp_path):
    small = ("friction.radius:=0.02", "friction.coefficient:=1e-6", "friction.preload:=-1e-7")
    with connector(*small, "plant.body_b.twist:=[1e-7, 0, 0, 0, 0, 0]", "limits.force:=.inf"):
        tool = Tool(peer)
        before = tool.get(*tool.names())
        tool.dump(tmp_path / "dump.yaml")
        text = (tmp_path / "dump.yaml").read_text()
        assert "max_force: .inf" in text
        assert "force: .nan" in text
        assert "inertia: []" in text
        assert tool.load(tmp_path / "dump.yaml") == []
        assert str(tool.get(*tool.names())) == str(before)
        assert tool.set(number("friction.max_force", 5.0))[0].successful
        assert tool.load(tmp_path / "dump.yaml") == []
        assert str(tool.get(*tool.names())) == str(before)
    file = ["--ros-args", "--params-file", tmp_path / "dump.yaml"]
    with program([*installed(installed_prefix, "connector"), *file], tmp_path):
        peer.spin_until(lambda: peer.node.count_subscribers("/body_b/pose"), "the connector")
        assert str(tool.get(*tool.names())) == str(before)


def test_values_have_the_type_of_their_parameter(connector, peer):
    with connector("friction.radius:=0.02"):
        tool = Tool(peer)
        integers = ParameterValue(
            type=ParameterType.PARAMETER_INTEGER_ARRAY, integer_array_value=[0, 0, -9]
        )
        assert tool.set(whole("friction.coefficient", 1))[0].successful
        assert tool.set(Parameter(name="gravity", value=integers))[0].successful
        coefficient, gravity = tool.get("friction.coefficient", "gravity")
        assert coefficient.type == ParameterType.PARAMETER_DOUBLE
        assert coefficient.double_value == 1.0
        assert list(gravity.double_array_value) == [0.0, 0.0, -9.0]


@pytest.mark.parametrize(
    ("name", "value", "default"), [("friction.coefficient", 0.2, 0.0), ("limits.force", 7.0, "inf")]
)
def test_a_parameter_that_is_not_set_has_its_default_and_can_be_set_again(
    name, value, default, connector, peer
):
    with connector("friction.radius:=0.02", f"{name}:={value}"):
        tool = Tool(peer)
        assert tool.set(Parameter(name=name))[0].successful
        assert tool.get(name)[0].double_value == float(default)
        assert tool.set(number(name, 3.0))[0].successful
        assert tool.get(name)[0].double_value == 3.0
        result = tool.set(Parameter(name="node_a.orientation"))[0]
        assert result.reason.startswith("node_a.orientation: is required")
        assert len(tool.get("node_a.orientation")[0].double_array_value) == 4


def test_read_only_parameters_and_texts_are_refused_with_the_rule(connector, peer):
    with connector():
        tool = Tool(peer)
        results = tool.set(
            Parameter(name="input", value=ParameterValue(type=4, string_value="odometry")),
            Parameter(name="input", value=ParameterValue(type=4, string_value="pose_twist")),
            Parameter(name="timeout", value=ParameterValue(type=4, string_value="soon")),
            Parameter(name="timeout", value=ParameterValue(type=4, string_value="nan")),
        )
        assert [result.successful for result in results] == [False, True, False, False]
        assert "timeout = 'soon': must be a number > 0 s" in results[2].reason
