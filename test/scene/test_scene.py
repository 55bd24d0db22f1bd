"""Scenes: what is accepted, what is refused and in which words, files, and the documents."""

import dataclasses
import math
import re
from typing import Any, cast

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from paths import ROOT

from cylconn_ros.errors import SceneError
from cylconn_ros.scene import documentation, parameter_file
from cylconn_ros.scene.scene import Body, Friction, Node, Scene, load, load_all, schema
from cylconn_ros.scene.schema import Parameter, flatten, show

LEAST = {
    "node_a.orientation": [0.0, 0.0, 0.0, 1.0],
    "body_b.mass": 1.0,
    "body_b.inertia": [0.002, 0.0, 0.0, 0.003, 0.0, 0.004],
}


def make(**changes):
    """A scene from the least parameters and changes, dots written as two underscores."""
    dotted = {name.replace("__", "."): value for name, value in changes.items()}
    return Scene.from_parameters({**LEAST, **dotted})


def same(one: Scene, other: Scene) -> bool:
    return [show(value) for value in one.parameters().values()] == [
        show(value) for value in other.parameters().values()
    ]


def test_least_scene_has_the_defaults():
    scene = make()
    assert (scene.body_a.kind, scene.body_b.kind) == ("fixed", "free")
    assert scene.period == 0.001
    assert scene.gravity == (0.0, 0.0, -9.81)
    assert math.isnan(scene.friction.radius)
    assert not scene.friction.on
    assert scene.friction.table is None


def test_nested_and_dotted_names_mean_the_same():
    nested = {
        "node_a": {"orientation": [0, 0, 0, 1]},
        "body_b": {"mass": 1, "inertia": LEAST["body_b.inertia"]},
        "friction": {"coefficient": 0.3, "radius": 0.02},
    }
    assert same(
        Scene.from_parameters(nested), make(friction__coefficient=0.3, friction__radius=0.02)
    )


def test_whole_numbers_are_numbers():
    scene = make(timeout=1, gravity=[0, 0, -10], friction__preload=np.float32(2), latency=0.0)
    assert isinstance(scene.timeout, float)
    assert scene.gravity == (0.0, 0.0, -10.0)
    assert scene.latency == 0
    assert isinstance(scene.latency, int)


def test_arrays_are_lists():
    assert make(gravity=np.array([1.0, 2.0, 3.0])).gravity == (1.0, 2.0, 3.0)


def test_orientations_are_normalised_once():
    scene = make(node_a__orientation=[0.0, 0.0, 3.0, 4.0])
    assert scene.node_a.orientation == pytest.approx((0.0, 0.0, 0.6, 0.8))
    again = Scene.from_parameters(scene.parameters())
    assert again.node_a.orientation == scene.node_a.orientation  # to the last bit


@given(st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4))
def test_normalising_again_changes_no_bit(numbers):
    if math.hypot(*numbers) < 1e-6:
        return
    once = make(node_a__orientation=numbers).node_a.orientation
    assert make(node_a__orientation=once).node_a.orientation == once


def test_a_scene_made_in_python_is_checked_the_same():
    body = Body(frame="body_b", kind="free", mass=1, inertia=(0.002, 0.0, 0.0, 0.003, 0.0, 0.004))
    node = Node(orientation=(0, 0, 0, 2))
    assert same(Scene(body_b=body, node_a=node), make())
    with pytest.raises(SceneError, match=r"friction\.radius = \.nan: must be given with friction"):
        Scene(body_b=body, node_a=node, friction=Friction(coefficient=0.1))
    with pytest.raises(SceneError, match=r"node_a\.orientation: is required"):
        Scene(body_b=body, node_a=Node())


def test_replace_checks_again():
    with pytest.raises(SceneError, match=r"period = -1\.0"):
        dataclasses.replace(make(), period=-1.0)


def test_table_is_a_group_that_may_be_absent():
    table = {"rates": [0, 1], "forces": [1, 5, 9], "values": [0.3, 0.2, 0.1, 0.2, 0.2, 0.1]}
    scene = make(friction__table=table, friction__radius=0.02)
    assert scene.friction.table is not None
    assert scene.friction.table.forces == (1.0, 5.0, 9.0)
    assert scene.friction.on


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"period": -1}, "period = -1: must be a number >= 0 s and <= 1e+06 s, finite"),
        ({"period": math.inf}, "period = .inf: must be a number >= 0 s and <= 1e+06 s, finite"),
        ({"period": True}, "period = true: must be a number"),
        ({"period": "fast"}, "period = 'fast': must be a number"),
        ({"timeout": 0.0}, "timeout = 0.0: must be a number > 0 s"),
        ({"timeout": math.nan}, "timeout = .nan: must be a number > 0 s"),
        ({"latency": 1.5}, "latency = 1.5: must be an integer >= -1 samples"),
        ({"input": "topics"}, "input = 'topics': must be one of pose_twist, odometry"),
        ({"autostart": 1}, "autostart = 1: must be true or false"),
        ({"gravity": [0, 0]}, "gravity = [0, 0]: must be 3 numbers, finite (2 given)"),
        ({"gravity": [0, 0, "g"]}, "gravity = [0, 0, 'g']: must be 3 numbers, finite"),
        ({"gravity": [0, 0, math.nan]}, "gravity = [0, 0, .nan]: must be 3 numbers, finite"),
        ({"world_frame": ""}, "world_frame = '': must be a non-empty string"),
        ({"node_a__orientation": [0, 0, 0, 0]}, "an orientation of length 0 has no direction"),
        ({"node_b__orientation": [0, 0, 0, 0]}, "node_b.orientation = "),
        ({"node_a__orientation": None}, "node_a.orientation: is required and not given"),
        ({"body_b__mass": 0}, "body_b.mass = 0: must be a number > 0 kg"),
        ({"body_b__mass": None}, "body_b.mass = .nan: must be given, as body_b.kind is free"),
        ({"body_b__inertia": []}, "body_b.inertia = []: must be given"),
        ({"body_b__inertia": [1, 0, 0, 1, 0, -1]}, "must be positive definite"),
        ({"body_b__inertia": [1, 2, 0, 1, 0, 1]}, "must be positive definite"),
        ({"body_b__inertia": [1, 0, 0, 1, 0, 2.1]}, "no rigid body has it"),
        ({"body_b__kind": "fixed"}, "body_b.kind = 'fixed': body_a is fixed too"),
        ({"body_b__kind": "driven"}, "at least one body must be free or unknown"),
        ({"body_b__frame": "world"}, "body_b.frame = 'world': world_frame, body_a.frame and"),
        ({"method": "impulse", "body_b__kind": "unknown"}, "method = 'impulse': needs the inertia"),
        ({"friction__coefficient": 0.1}, "friction.radius = .nan: must be given with friction"),
        ({"friction__static_coefficient": 0.1}, "friction.decay = 0.0: must be > 0 s/m"),
        (
            {"friction__coefficient": 0.3, "friction__static_coefficient": 0.1},
            "friction.static_coefficient = 0.1: must be >= friction.coefficient (0.3)",
        ),
        ({"friction__radius": -0.02}, "friction.radius = -0.02: must be a number > 0 m"),
        (
            {"friction__table__rates": [1, 0], "friction__table__forces": [1]},
            "friction.table.rates = [1.0, 0.0]: must be ascending",
        ),
        ({"friction__table__rates": [1]}, "friction.table.forces = []: must be ascending"),
        (
            {"friction__table": {"rates": [0, 1], "forces": [1], "values": [0.1]}},
            "friction.table.values = [0.1]: must be 2 numbers, 2 rates times 1 forces (1 given)",
        ),
        (
            {
                "friction__table": {"rates": [0], "forces": [1], "values": [0.1]},
                "friction__coefficient": 0.2,
            },
            "friction.coefficient = 0.2: must not be given",
        ),
        ({"stops": {"l_min": 1, "l_max": 0}}, "stops.l_max = 0.0: must be > stops.l_min (1.0 m)"),
        ({"stops__restitution": 1.5}, "stops.restitution = 1.5: must be a number >= 0 and <= 1"),
        (
            {"command__slide__force": 1.0, "command__slide__velocity": 2.0},
            "command.slide.force = 1.0: must not be given with a motion",
        ),
        ({"latency": 21}, "latency = 21: must be at most 20 samples"),
        ({"lock__component": "slide"}, "lock.component = 'slide': needs a criterion"),
        ({"lock__force": 1.0}, "lock.component = 'none': must be slide or spin"),
        ({"stamp_tolerance": 0.0005}, "stamp_tolerance = 0.0005: must be less than half"),
        ({"fricton__radius": 1}, "fricton.radius = 1: no such parameter; did you mean friction.r"),
        ({"friction__mu": 1}, "friction.mu = 1: no such parameter; did you mean friction.coeff"),
        ({"preload": 500}, "preload = 500: no such parameter; did you mean friction.preload?"),
        ({"stops": 3}, "stops = 3: no such parameter; it is a group: give stops.l_min, "),
        ({"wholly_unheard_of": 1}, "wholly_unheard_of = 1: no such parameter"),
        ({"body_b": {"mass": 2}}, "body_b.mass = 2: is given twice, also as 1.0"),
    ],
)
def test_refused_in_words_that_name_parameter_value_and_rule(changes, text):
    with pytest.raises(SceneError) as caught:
        make(**changes)
    assert text in str(caught.value)


def test_a_plate_is_a_body():
    make(body_b__inertia=[1.0, 0.0, 0.0, 1.0, 0.0, 2.0])  # the triangle inequality's limit


def test_parameters_round_trip_with_every_value_changed(tmp_path):
    scene = make(
        friction={"coefficient": 0.1, "static_coefficient": 0.2, "decay": 3, "radius": 0.3},
        limits={"force": 5.0},
        plant={"body_a": {"pose": [1, 2, 3, 0, 0, 0, 1]}, "duration": 2},
        node_b__orientation=[1.0, 2.0, 3.0, 4.0],
        period=0.1 + 0.2,
    )
    path = tmp_path / "scene.yaml"
    path.write_text(parameter_file.dump(scene))
    assert same(load(path), scene)
    assert same(Scene.from_parameters(scene.parameters()), scene)
    assert set(scene.parameters()) == set(schema())


# --- files ---


def write(tmp_path, text):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


def test_a_node_s_own_block_comes_after_the_wildcards(tmp_path):
    path = write(
        tmp_path,
        """
connector: {ros__parameters: {period: 0.002}}
/**: {ros__parameters: {period: 0.001, timeout: 5}}
/other/connector: {ros__parameters: {period: 7}}
plant: {ros__parameters: {period: 0.003}}
ns: {connector: {ros__parameters: {timeout: 9}}}
/*: {ros__parameters: {twist_axes: body}}
""",
    )
    read = parameter_file.load_parameters(path, "connector")
    assert read == {"period": 0.002, "timeout": 5, "twist_axes": "body"}
    read = parameter_file.load_parameters(path, "connector", "/ns")
    assert read == {"period": 0.001, "timeout": 9}
    assert parameter_file.load_parameters(path, "plant", "/")["period"] == 0.003


def test_numbers_are_read_as_ros_reads_them():
    read = parameter_file.parse("[1e-3, 1.e3, .5, -.inf, .nan, 2, 1_000.5, true, x]")
    assert read[:4] == [0.001, 1000.0, 0.5, -math.inf]
    assert math.isnan(read[4])
    assert read[5:] == [2, 1000.5, True, "x"]


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("a: [1, ", "line 1: "),
        ("/**: {ros__parameters: {period: 1, period: 2}}", "line 1: period is given twice"),
        ("period: 1", "/period = 1: must hold ros__parameters"),
        ("ros__parameters: {period: 1}", "ros__parameters: must be below a node's name"),
        ("[1, 2]", "is not a parameter file"),
        ("/**: {ros__parameters: {period: -1}}", "period = -1: must be a number >= 0 s"),
        ("/**: {ros__parameters: 5}", "ros__parameters must hold names and values"),
    ],
)
def test_unusable_files_are_refused_by_name(tmp_path, text, error):
    path = write(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert error in str(caught.value)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(SceneError, match=r"none\.yaml: cannot be read: No such file"):
        load(tmp_path / "none.yaml")


def test_parameters_of_ros_itself_are_left_alone(tmp_path):
    least = {**LEAST, "use_sim_time": False, "qos_overrides": {"/a": {"x": 1}}}
    path = write(tmp_path, yaml.safe_dump({"/**": {"ros__parameters": least}}))
    assert same(load(path), make())


# --- documents ---


@pytest.mark.parametrize(
    "path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda path: path.name
)
def test_every_scene_file_of_the_project_can_be_used(path):
    load_all(path)


GIVEN: dict[str, Any] = {
    "node_a": Node(orientation=(0, 0, 0, 1)),
    "body_b": Body(mass=1.0, inertia=(1, 0, 0, 1, 0, 1)),
}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"node_a": (0, 0, 0, 1)}, "node_a = [0, 0, 0, 1]: must be a Node"),
        ({"body_b": None}, "body_b = null: must be a Body"),
        (
            {"friction": Friction(table=cast(Any, "x"))},
            "friction.table = 'x': must be a FrictionTable",
        ),
        ({"body_b": Body(mass=1.0, inertia=cast(Any, np.eye(3)))}, "must be 6 numbers"),
        ({"node_a": Node(orientation=cast(Any, np.zeros(0)))}, "node_a.orientation: is required"),
    ],
)
def test_a_scene_built_in_code_is_checked_like_a_file(changes, text):
    with pytest.raises(SceneError, match=re.escape(text)):
        Scene(**{**GIVEN, **changes})
    array = Body(mass=1.0, inertia=cast(Any, np.array([1, 0, 0, 1, 0, 1])))
    assert Scene(**{**GIVEN, "body_b": array}) == Scene(**GIVEN)
    assert Scene(**GIVEN).body_b.frame == "body_b"


@pytest.mark.parametrize(
    ("path", "make_text"),
    [
        ("docs/reference/parameters.md", documentation.table),
        ("config/connector.yaml", documentation.example),
    ],
)
def test_documents_agree_with_the_scene(path, make_text):
    assert (ROOT / path).read_text() == make_text(), "see cylconn_ros/scene/documentation.py"


def test_the_example_gives_every_parameter():
    document = yaml.safe_load((ROOT / "config" / "connector.yaml").read_text())
    assert list(flatten(document["/**"]["ros__parameters"])) == list(schema())
    assert same(load(ROOT / "config" / "connector.yaml"), make())


@pytest.mark.parametrize("parameter", schema().values(), ids=lambda parameter: parameter.name)
def test_every_parameter_is_described_and_its_default_allowed(parameter: Parameter):
    assert parameter.doc.endswith(".")
    if parameter.kind in ("float", "vector"):
        assert parameter.unit
    if not parameter.required and parameter.name not in ("body_a.frame", "body_b.frame"):
        assert show(parameter.check(parameter.default)) == show(parameter.default)
    if parameter.required:
        assert parameter.check(parameter.example) is not None
