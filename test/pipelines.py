"""A message pipeline and a plant exchanging serialized messages, without processes."""

from cylconn_ros.messages.pipeline import Answering
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

MS = 1_000_000
INERTIA = [0.002, 1e-4, 0.0, 0.003, 0.0, 0.004]


def make(**changes):
    parameters = {
        "node_a.orientation": [0, 0, 0, 1],
        "body_a": {"kind": "free", "mass": 3, "inertia": INERTIA},
        "body_b": {"kind": "free", "mass": 1, "inertia": INERTIA, "com": [0.01, 0.02, 0]},
        "plant.body_b.twist": [0.5, 0, 0, 2, 0, 0],
        "friction.radius": 0.02,
    }
    parameters.update({name.replace("__", "."): value for name, value in changes.items()})
    return Scene.from_parameters(parameters)


class Loop:
    """A plant and an answering connector exchanging bytes."""

    def __init__(self, scene: Scene) -> None:
        self.plant = Plant(scene)
        self.exchange = Exchange(scene, PlantCounts())
        self.answering = Answering(scene)

    def sample(self):
        """Send the plant's sample; the answer to its last message."""
        answer = None
        for name, data in self.exchange.messages(self.plant.time_ns, self.plant.state):
            assert answer is None
            answer = self.answering.inputs[name].receive(data)
        return answer

    def step(self):
        answer = self.sample()
        assert answer is not None
        self.exchange.take(0, answer.wrench_a, self.plant.time_ns)
        self.exchange.take(1, answer.wrench_b, self.plant.time_ns)
        assert self.exchange.complete
        self.plant.step(*self.exchange.wrenches)
        self.exchange.expect()
        return answer
