"""A message pipeline and a plant that exchange serialized messages, without processes."""

from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

MS = 1_000_000
INERTIA = [0.002, 1e-4, 0.0, 0.003, 0.0, 0.004]


def make(**changes):
    """A scene with two free bodies; ``__`` in a name stands for a dot."""
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
    """A plant and a message pipeline in lock step."""

    def __init__(self, scene: Scene) -> None:
        self.plant = Plant(scene)
        self.exchange = Exchange(scene, PlantCounts())
        self.pipeline = MessagePipeline(scene)

    def sample(self):
        """Send the plant's sample; the response to its last message."""
        response = None
        for name, data in self.exchange.messages(self.plant.time_ns, self.plant.state):
            assert response is None
            response = self.pipeline.inputs[name].receive(data)
        return response

    def step(self):
        """Send the plant's sample, apply the wrenches and step the plant; the response."""
        response = self.sample()
        assert response is not None
        self.exchange.receive(0, response.wrench_a, self.plant.time_ns)
        self.exchange.receive(1, response.wrench_b, self.plant.time_ns)
        assert self.exchange.complete
        self.plant.step(*self.exchange.wrenches)
        self.exchange.begin_sample()
        return response
