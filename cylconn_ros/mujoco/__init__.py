"""MuJoCo models as the simulator of a connector; MuJoCo is the optional extra ``mujoco``."""
