"""The law check: the laws hold, and it detects mistakes in each part of the step."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT
from scenes import bundled

import cylconn_ros as cr
from cylconn_ros.cli.main import main
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.laws import order, residuals, sampling, selection
from cylconn_ros.laws.guarantees import GUARANTEES, guaranteed_laws, title
from cylconn_ros.laws.runs import first_violation
from cylconn_ros.laws.summary import REQUIRED_REGIMES, LawSummary
from cylconn_ros.methods.traits import TRAITS


@pytest.fixture(scope="module")
def sampled() -> list[sampling.SampledBlock]:
    """Three blocks: 24576 samples."""
    return [part for number in range(3) for part in sampling.blocks(1, number, "impulse")]


def test_the_laws_hold_in_every_regime(sampled: list[sampling.SampledBlock]) -> None:
    summary = LawSummary()
    for part in sampled:
        columns = (part.number, part.chain, part.index)
        summary.add(residuals.check(part.block), part.block.out, columns)
    assert summary.samples == 24576
    off = {name: law.location for name, law in summary.laws.items() if not law.holds}
    assert off == {}
    assert list(summary.laws) == guaranteed_laws("impulse")
    assert all(law.samples > 1000 for law in summary.laws.values())
    assert [name for name in REQUIRED_REGIMES if summary.share(name) < 0.01] == []
    assert summary.share("not converged") < 1e-3  # of which most laws are not stated


def test_outputs_are_the_roots_that_the_rule_selects(
    sampled: list[sampling.SampledBlock],
) -> None:
    found = selection.SelectionSummary()
    for part in sampled[:3]:
        found.add(selection.check(part.block), part.number, part.chain, part.index)
    assert found.locations == []
    assert (
        found.checked > 0.7 * found.samples
    )  # not: the steps of impacts, which have their own law
    assert found.several > 40
    assert found.impacts > 10  # at which the stop acts
    assert found.ambiguous < 0.01 * found.samples


def test_a_block_is_reproducible_alone(sampled: list[sampling.SampledBlock]) -> None:
    again = list(sampling.blocks(1, 1, "impulse"))
    for part, other in zip(sampled[sampling.LENGTH :], again, strict=False):
        np.testing.assert_array_equal(part.block.sample, other.block.sample)
        np.testing.assert_array_equal(part.block.out, other.block.out)


@pytest.mark.parametrize(
    ("field", "law"),
    [
        (layout.FORCE + 1, "constraint"),
        (layout.MOMENT + 2, "constraint"),
        (layout.FORCE_FRICTION, "friction_limit"),
        (layout.FORCE_VISCOUS, "balance"),
        (layout.NORMAL_FORCE, "balance"),
        (layout.TORQUE_A + 1, "balance"),
        (layout.FORCE_B, "balance"),
    ],
)
def test_a_wrong_output_field_is_detected(
    sampled: list[sampling.SampledBlock], field: int, law: str
) -> None:
    """An output that is wrong by one millionth violates the law of its field."""
    block = sampled[0].block
    out = block.out.copy()
    out[:, field] *= 1.0 + 1e-6
    found = residuals.check(dataclasses.replace(block, out=out))[law]
    changed = out[:, field] != 0.0
    if law == "friction_limit":  # below the limit, stick allows the change
        changed &= out[:, layout.REGIME] == layout.SLIP
    assert np.nanmean(found[changed] > 1e-12) > 0.5


def test_a_value_that_is_not_finite_is_detected(sampled: list[sampling.SampledBlock]) -> None:
    block = sampled[0].block
    out = block.out.copy()
    out[5, layout.FORCE_A] = np.nan
    assert residuals.check(dataclasses.replace(block, out=out))["balance"][5] == np.inf


# Mistakes as changes to the uncompiled physics, and the law that has to be reported as violated.
MISTAKES = {
    "nothing": ("", ""),
    "friction with the wrong sign": (
        """
def wrong(law, par, d, was_stick):
    found = solve(law, par, d, was_stick)
    slips = found.regime == layout.SLIP
    return found._replace(phi=(-found.phi[0], -found.phi[1])) if slips else found
complementarity.solve_disc = wrong
""",
        "dissipation",
    ),
    "factor 2 in Fbend": (
        """
whole = slip_curve.contact
def half(law, reaction):
    return whole(law._replace(bending=0.5 * law.bending), reaction)
slip_curve.contact = friction_disc.contact = complementarity.contact = half
""",
        "friction limit",
    ),
    "FN of the previous step": (
        """
last = {}
nothing = (0.0, 0.0, 0.0, 0.0)
def wrong(law, par, d, was_stick):
    lagged = d._replace(base=last.get(id(par), d.base), c1=nothing, c2=nothing)
    found = solve(law, par, lagged, was_stick)
    last[id(par)] = slip_curve.reaction(d, found.phi)
    return found
complementarity.solve_disc = wrong
""",
        "friction limit",
    ),
    "box instead of disc": (
        """
def wrong(law, par, d, was_stick):
    found = solve(law, par, d, was_stick)
    if found.regime != layout.SLIP:
        return found
    size = math.hypot(*found.phi)
    return found._replace(phi=tuple(math.copysign(size, x) for x in found.phi))
complementarity.solve_disc = wrong
""",
        "friction limit",
    ),
    "first root skipped": (
        """
complementarity.solve_disc = lambda law, par, d, was_stick: solve(law, par, d, True)
""",
        "roots",
    ),
    "stops reached half a step late": (
        """
joint_limits._contact_rate = lambda gap, w, h, pull, explicit, alpha: min(-gap / h, pull)
""",
        "stops",
    ),
    "a held misalignment turned about e1a": (
        """
kinematics.aligned = lambda swing: True
""",
        "constraint",
    ),
    "less restitution than gains no energy": (
        """
def wrong(par, r, rates, k, side, eps, fixed):
    return impulses(par, r, rates, k, side, 0.9 * eps, fixed)
contacts.impulses = wrong
""",
        "roots",
    ),
    "impacts with the friction of their steps": (
        """
def wrong(*given):
    return (*impact(*given)[:2], False)
contacts.solve_impact = wrong
""",
        "slip direction",
    ),
    "impacts without friction": (
        """
def wrong(par, r, rates, k, side, eps, fixed):
    return impulses(par, r, rates, k, side, eps, fixed)._replace(ratio=(0.0, 0.0))
contacts.impulses = wrong
""",
        "slip direction",
    ),
}
DRIVER = """
import contextlib, io, json, math, sys
from cylconn_ros.core import friction_disc, joint_limits, kinematics, layout, slip_curve
from cylconn_ros.laws import sampling
from cylconn_ros.methods.free_axes import complementarity, contacts
from cylconn_ros.methods.free_axes import step as free_axes
from cylconn_ros.cli.main import main
sampling.BLOCK, sampling.CHAINS = 40, 1  # so that a scene's last step is the connector's last
modules = [joint_limits, slip_curve, friction_disc, kinematics, free_axes, complementarity,
    contacts]
original = [dict(vars(module)) for module in modules]
solve, results = complementarity.solve_disc, {}
impulses, impact = contacts.impulses, contacts.solve_impact
for name, (change, roots) in json.loads(sys.argv[1]).items():
    exec(change, dict(globals()))
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(io.StringIO()):
        command = f"laws --seed 3 --samples 320 --roots {roots} --library 0 --no-order"
        code = main(command.split())
    results[name] = code, text.getvalue()
    for module, names in zip(modules, original):
        vars(module).update(names)
print(json.dumps(results))
"""


@pytest.fixture(scope="module")
def reports() -> dict[str, tuple[int, str]]:
    """Exit code and report for each of MISTAKES."""
    changes = {name: (how, 320 * (law in ("", "roots"))) for name, (how, law) in MISTAKES.items()}
    done = subprocess.run(
        [sys.executable, "-c", DRIVER, json.dumps(changes)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "CYLCONN_NO_COMPILER": "1"},
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, tuple[int, str]] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_detected(reports: dict[str, tuple[int, str]], name: str) -> None:
    law = MISTAKES[name][1]
    code, text = reports[name]
    line = next((x for x in text.splitlines() if x.startswith("VIOLATED")), "")
    named = line.removeprefix("VIOLATED: ").split(", ") if line else [""]
    assert (code, law in named) == (1 if law else 0, True), text


# --- orders of convergence ---


def test_orders_are_the_stated_ones() -> None:
    fits = order.fits(only=("two free bodies 20:1",))
    assert [fit.quantity for fit in fits] == ["position", "rate", "direction"]
    assert [fit for fit in fits if not fit.holds] == []


def test_an_order_that_is_too_low_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrenches too large by 1 % reduce the order of the position from three to two."""
    step = Connector.step

    def large(self: Connector, sample: np.ndarray) -> np.ndarray:
        out = step(self, sample)
        out[: layout.STATE0] *= 1.01
        return out

    monkeypatch.setattr(Connector, "step", large)
    assert any(not fit.holds for fit in order.fits(only=("two free bodies 20:1",)))


# --- the command ---


def test_a_recorded_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that slides, comes to rest and stays at rest."""
    run = tmp_path / "run"
    assert bundled("coast").plant.duration > 0.4
    assert main(["simulate", "coast", "-o", str(run)]) == 0
    capsys.readouterr()
    assert main(["laws", "--run", str(run)]) == 0
    text = capsys.readouterr().out
    assert "\nstick " in text
    assert "\nslip direction " in text
    assert "skipped" not in text
    assert "next:" in text


def test_a_random_scene_by_its_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["laws", "--seed", "3", "--scene", "70", "--roots", "0"]) == 0
    text = capsys.readouterr().out
    assert f"{sampling.CHAINS * sampling.LENGTH} samples, seed 3" in text


@pytest.mark.parametrize("method", GUARANTEES)
def test_each_method_holds_its_guarantees(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    """For its runs of the bundled scenes, and for random samples if it processes samples."""
    live = TRAITS[method].live
    samples = "2048" if live else "0"
    command = f"laws --method {method} --samples {samples} --roots 0 --library 40 --no-order"
    assert main(command.split()) == 0
    text = capsys.readouterr().out
    heading = "bundled scenes," if live else "motions of the bundled scenes"
    scenes = text[text.index(heading) :]
    for law in guaranteed_laws(method):
        assert f"\n{title(law)} " in scenes


def test_a_recorded_run_between_stops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert main(["simulate", "between_stops", "-o", str(run), "--duration", "0.4"]) in (0, 1)
    capsys.readouterr()
    assert main(["laws", "--run", str(run)]) == 0
    text = capsys.readouterr().out
    assert "\nstops " in text
    assert "restitution          0" not in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--method", "unknown"], "--method unknown: laws are stated for impulse, minimal"),
        (["--method", "minimal", "--samples", "100"], "computes whole motions"),
    ],
)
def test_unsuitable_methods_are_rejected(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["laws", *options]) == 2
    assert message in capsys.readouterr().err


def test_a_penalty_run_at_stops_is_checked_without_inertia() -> None:
    """Its stops are springs: no motion towards them is computed, which needs the inertia."""
    scene = cr.Scene(
        method="penalty",
        penalty=cr.Penalty(
            stiffness=1e5, damping=300.0, rotational_stiffness=1e3, rotational_damping=3.0,
        ),
        body_a=cr.Body(kind="fixed"),
        body_b=cr.Body(kind="free", mass=2.0, inertia=(0.01, 0.0, 0.0, 0.02, 0.0, 0.02)),
        node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
        stops=cr.Stops(l_max=0.01),
        plant=cr.PlantSettings(body_b=cr.PlantBody(twist=(0.3, 0.0, 0.0, 1.0, 0.0, 0.0))),
    )  # fmt: skip
    run = cr.simulate(scene, samples=100)
    assert (run["stop"] != 0).any()
    unknown = dataclasses.replace(scene, body_b=cr.Body(kind="unknown"))
    assert first_violation(unknown, run.states, run.outs) == ""
