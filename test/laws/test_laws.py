"""The law checker: the laws hold, and it sees each of the mistakes that are easily made."""

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

from cylconn_ros.cli.main import main
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.laws import claims, order, residuals, sampling, selection
from cylconn_ros.laws.summary import STEERED, Tally


@pytest.fixture(scope="module")
def drawn() -> list[sampling.Drawn]:
    """Three blocks: 24576 samples."""
    return [part for number in range(3) for part in sampling.blocks(1, number, "impulse")]


def test_the_laws_hold_and_every_regime_is_met(drawn: list[sampling.Drawn]) -> None:
    tally = Tally()
    for part in drawn:
        where = (part.number, part.chain, part.place)
        tally.add(residuals.check(part.block), part.block.out, where)
    assert tally.samples == 24576
    assert {letter: law.where for letter, law in tally.laws.items() if not law.holds} == {}
    assert set(tally.laws) == set(claims.claimed("impulse"))
    assert all(law.samples > 1000 for law in tally.laws.values())
    assert [name for name in STEERED if tally.share(name) < 0.01] == []


def test_answers_are_the_roots_that_the_rule_names(drawn: list[sampling.Drawn]) -> None:
    verdict = selection.Verdict()
    for part in drawn[:3]:
        verdict.add(selection.judge(part.block), part.number, part.chain, part.place)
    assert verdict.where == []
    assert verdict.judged > 0.8 * verdict.samples
    assert verdict.several > 40
    assert verdict.impacts > 30
    assert verdict.unsure < 0.01 * verdict.samples


def test_a_draw_can_be_had_again(drawn: list[sampling.Drawn]) -> None:
    again = list(sampling.blocks(1, 1, "impulse"))
    for part, other in zip(drawn[sampling.LENGTH :], again, strict=False):
        np.testing.assert_array_equal(part.block.sample, other.block.sample)
        np.testing.assert_array_equal(part.block.out, other.block.out)


@pytest.mark.parametrize(
    ("field", "law"),
    [
        (layout.FORCE + 1, "C"),
        (layout.MOMENT + 2, "C"),
        (layout.FORCE_FRICTION, "D"),
        (layout.FORCE_VISCOUS, "A"),
        (layout.NORMAL_FORCE, "A"),
        (layout.TORQUE_A + 1, "A"),
        (layout.FORCE_B, "A"),
    ],
)
def test_a_wrong_number_is_seen(drawn: list[sampling.Drawn], field: int, law: str) -> None:
    """An answer off by a millionth breaks the law that speaks of it."""
    block = drawn[0].block
    out = block.out.copy()
    out[:, field] *= 1.0 + 1e-6
    found = residuals.check(dataclasses.replace(block, out=out))[law]
    changed = out[:, field] != 0.0
    if law == "D":  # a stuck sleeve may hold a millionth more
        changed &= out[:, layout.REGIME] == layout.SLIP
    assert np.nanmean(found[changed] > 1e-12) > 0.5


def test_not_a_number_is_seen(drawn: list[sampling.Drawn]) -> None:
    block = drawn[0].block
    out = block.out.copy()
    out[5, layout.FORCE_A] = np.nan
    assert residuals.check(dataclasses.replace(block, out=out))["A"][5] == np.inf


# What is broken, as a change to the uncompiled physics, and what has to be named for it.
BREAKS = {
    "nothing": ("", ""),
    "sign of friction": (
        """
def broken(law, par, d, was_stick):
    found = solve(law, par, d, was_stick)
    slips = found.regime == layout.SLIP
    return found._replace(phi=(-found.phi[0], -found.phi[1])) if slips else found
sides.solve_disc = broken
""",
        "E",
    ),
    "factor 2 in Fbend": (
        """
whole = curve.contact
def half(law, reaction):
    return whole(law._replace(bending=0.5 * law.bending), reaction)
curve.contact = disc.contact = sides.contact = half
""",
        "D",
    ),
    "last step's FN": (
        """
last = {}
nothing = (0.0, 0.0, 0.0, 0.0)
def broken(law, par, d, was_stick):
    lagged = d._replace(base=last.get(id(par), d.base), c1=nothing, c2=nothing)
    found = solve(law, par, lagged, was_stick)
    last[id(par)] = curve.reaction(d, found.phi)
    return found
sides.solve_disc = broken
""",
        "D",
    ),
    "box instead of disc": (
        """
def broken(law, par, d, was_stick):
    found = solve(law, par, d, was_stick)
    if found.regime != layout.SLIP:
        return found
    size = math.hypot(*found.phi)
    return found._replace(phi=tuple(math.copysign(size, x) for x in found.phi))
sides.solve_disc = broken
""",
        "D",
    ),
    "first root skipped": (
        """
sides.solve_disc = lambda law, par, d, was_stick: solve(law, par, d, True)
""",
        "roots",
    ),
    "stops reached half a step late": (
        """
bounds._least_rate = lambda gap, w, h, pull, explicit: min(-gap / h, pull)
""",
        "U",
    ),
    "a held misalignment turned about e1a": (
        """
kinematics.aligned = lambda swing: True
""",
        "C",
    ),
    "restitution that gains energy": (
        """
available.restitution_without_gain = lambda *given: given[-1]
""",
        "roots",
    ),
}
DRIVER = """
import contextlib, io, json, math, sys
from cylconn_ros.core import bounds, curve, disc, kinematics, layout
from cylconn_ros.laws import sampling
from cylconn_ros.methods import available, sides
from cylconn_ros.cli.main import main
sampling.BLOCK, sampling.CHAINS = 40, 1  # so that a scene's last step is the connector's last
modules = [bounds, curve, disc, kinematics, available, sides]
sound = [dict(vars(module)) for module in modules]
solve, told = sides.solve_disc, {}
for name, (change, roots) in json.loads(sys.argv[1]).items():
    exec(change, dict(globals()))
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(io.StringIO()):
        asked = f"laws --seed 3 --samples 320 --roots {roots} --library 0 --no-order"
        code = main(asked.split())
    told[name] = code, text.getvalue()
    for module, names in zip(modules, sound):
        vars(module).update(names)
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def broken() -> dict[str, tuple[int, str]]:
    """Exit code and report of each of BREAKS."""
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            DRIVER,
            json.dumps(
                {name: (how, 320 * (law in ("", "roots"))) for name, (how, law) in BREAKS.items()}
            ),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "CYLCONN_NO_COMPILER": "1"},
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, tuple[int, str]] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("name", BREAKS)
def test_broken_on_purpose(broken: dict[str, tuple[int, str]], name: str) -> None:
    law = BREAKS[name][1]
    code, text = broken[name]
    line = next((x for x in text.splitlines() if x.startswith("BROKEN")), "")
    named = line.removeprefix("BROKEN: ").split(" (")[0].split(", ") if line else [""]
    assert (code, law in named) == (1 if law else 0, True), text


# --- law O ---


def test_orders_are_the_stated_ones() -> None:
    fits = order.fits(only=("two free bodies 20:1",))
    assert [fit.what for fit in fits] == ["position", "rate", "direction"]
    assert [fit for fit in fits if not fit.holds] == []


def test_an_order_too_low_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrenches a hundredth too large leave an error of second order where the third is stated."""
    step = Connector.step

    def large(self: Connector, sample: np.ndarray) -> np.ndarray:
        out = step(self, sample)
        out[: layout.STATE0] *= 1.01
        return out

    monkeypatch.setattr(Connector, "step", large)
    assert any(not fit.holds for fit in order.fits(only=("two free bodies 20:1",)))


# --- the command ---


def test_a_recorded_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The samples of a run: sliding, coming to rest, resting."""
    run = tmp_path / "run"
    assert bundled("coast").plant.duration > 0.4
    assert main(["simulate", "coast", "-o", str(run)]) == 0
    capsys.readouterr()
    assert main(["laws", "--run", str(run)]) == 0
    text = capsys.readouterr().out
    assert "K stick" in text
    assert "S slip" in text
    assert "left out" not in text


def test_a_scene_by_its_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["laws", "--seed", "3", "--scene", "70", "--roots", "0"]) == 0
    text = capsys.readouterr().out
    assert f"{sampling.CHAINS * sampling.LENGTH} samples, seed 3" in text


@pytest.mark.parametrize("method", claims.CLAIMS)
def test_each_method_holds_what_it_claims(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    """On its own runs of the scene library, and all but minimal on random samples too."""
    samples = "0" if method == "minimal" else "2048"
    asked = f"laws --method {method} --samples {samples} --roots 0 --library 40 --no-order"
    assert main(asked.split()) == 0
    text = capsys.readouterr().out
    assert "scenes of the library" in text
    library = text[text.index("scenes of the library") :]
    for letter in claims.claimed(method):
        assert f"\n{letter} {claims.TITLES[letter]}" in text if samples != "0" else library
    assert ("the motion itself" in text) == (method == "minimal")


def test_a_recorded_run_between_stops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert main(["simulate", "between_stops", "-o", str(run), "--duration", "0.4"]) in (0, 1)
    capsys.readouterr()
    assert main(["laws", "--run", str(run)]) == 0
    text = capsys.readouterr().out
    assert "U stops" in text
    assert "restitution          0" not in text


def test_a_method_without_stated_laws_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["laws", "--method", "wishful"]) == 2
    assert "wishful" in capsys.readouterr().err
