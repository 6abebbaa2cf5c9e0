"""Friction that takes energy as a whole: rows against curves and cycles computed one by one."""

from dataclasses import replace

import numpy as np
import pytest

from invented import single, tree
from moving import geared
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
)
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.prior.body_priors import Knowledge, Row, default_knowledge
from steelyard.estimate.prior.dissipative_friction import REACH, dissipation_rows, shaped
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    Cubic,
    DirectionalCoulomb,
    DirectionalViscous,
    Quadratic,
    Root,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.friction_with_memory import Dahl, LuGre, MaxwellSlip
from steelyard.model.laws.laws_without_friction import Offset, RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.robot import Coordinate, Limits

FASTEST = 2.0
LENGTHS = (1e-3, 4e-3, 1e-2)


def rows_of(*laws: Term) -> tuple[Row, ...]:
    return dissipation_rows(Model(single(), laws), [FASTEST])


def least(rows: tuple[Row, ...], values: dict[str, float]) -> float:
    """The least of all rows."""
    return min(sum(values[n] * a for n, a in row.coefficients.items()) for row in rows)


def test_a_row_holds_the_curve_at_one_speed() -> None:
    rows = rows_of(Coulomb(), Viscous(), Quadratic())
    speeds = np.array(
        [r.coefficients.get("viscous.hinge", 0.0) / r.coefficients["coulomb.hinge"] for r in rows]
    )
    squares = [
        r.coefficients.get("quadratic.hinge", 0.0) / r.coefficients["coulomb.hinge"] for r in rows
    ]
    np.testing.assert_allclose(squares, speeds**2, rtol=1e-5, atol=1e-9)
    assert speeds.max() == pytest.approx(REACH * FASTEST, rel=1e-6) and speeds.min() < 1e-2
    assert all(row.lower == 0.0 and row.upper == np.inf for row in rows)
    assert "up to 3 rad/s" in rows[0].label and "'hinge'" in rows[0].label


@pytest.mark.parametrize("law", [Quadratic(), Cubic(), Root(), Stribeck(speed=0.3)])
def test_rows_hold_where_the_curve_takes_energy_and_only_there(law: Quadratic | Stribeck) -> None:
    """Random coefficients, against the curve on a fine grid."""
    rows, rng = rows_of(Coulomb(), Viscous(), law), np.random.default_rng(3)
    v = np.linspace(1e-4, REACH * FASTEST, 4000)
    other = {
        "quadratic": v**2, "cubic": v**3, "root": np.sqrt(v), "stribeck": np.exp(-v / 0.3),
    }[law.law]  # fmt: skip
    outcomes = set()
    for _ in range(300):
        c, d, x = rng.uniform(0.0, 1.0), rng.uniform(0.0, 1.0), rng.uniform(-1.5, 0.5)
        curve = c + d * v + x * other
        values = {"coulomb.hinge": c, "viscous.hinge": d, f"{law.law}.hinge": x}
        if abs(curve.min()) < 0.02:
            continue
        assert (least(rows, values) >= 0.0) == (curve.min() > 0.0)
        outcomes.add(bool(curve.min() > 0.0))
    assert outcomes == {True, False}


def test_both_directions_are_checked() -> None:
    rows = rows_of(DirectionalCoulomb(), DirectionalViscous(), Quadratic())
    names = {frozenset(row.coefficients) for row in rows}
    assert {"directional_coulomb_forward.hinge", "directional_viscous_forward.hinge",
            "quadratic.hinge"} in names  # fmt: skip
    assert {"directional_coulomb_backward.hinge", "directional_viscous_backward.hinge",
            "quadratic.hinge"} in names  # fmt: skip


def energy(forces: dict[str, float], path: np.ndarray) -> float:
    """Energy that Coulomb friction and elements that slip take along a path, step by step."""
    states, total = dict.fromkeys(LENGTHS, 0.0), 0.0
    for step in np.diff(path):
        total += forces["coulomb.hinge"] * abs(step)
        for k, length in enumerate(LENGTHS):
            before = states[length]
            states[length] = float(np.clip(before + step / length, -1.0, 1.0))
            total += forces[f"maxwell_slip{k + 1}.hinge"] * 0.5 * (before + states[length]) * step
    return total


@pytest.mark.slow
def test_elements_that_slip_give_no_energy_in_any_closed_cycle() -> None:
    """Some of them negative; random nested cycles, walked through until they repeat."""
    rows = rows_of(Coulomb(), MaxwellSlip(lengths=LENGTHS))
    rng, tried, negative = np.random.default_rng(5), 0, 0
    while tried < 12:
        values = {"coulomb.hinge": rng.uniform(0.0, 0.5)}
        values |= {f"maxwell_slip{k}.hinge": rng.uniform(-1.0, 1.0) for k in (1, 2, 3)}
        if least(rows, values) < 0.0:
            continue
        tried += 1
        negative += min(values.values()) < 0.0
        corners = rng.uniform(-1.5e-2, 1.5e-2, 6)
        cycle = np.concatenate(
            [
                np.linspace(a, b, 200)[:-1]
                for a, b in zip(corners, np.roll(corners, -1), strict=True)
            ]
        )
        once, twice = (energy(values, np.tile(cycle, n)) for n in (2, 3))
        assert twice - once > -1e-6
    assert negative > 3


def test_a_cycle_that_gives_energy_is_forbidden() -> None:
    """Total friction is positive in full sliding, but small cycles would drive the joint."""
    rows = rows_of(Coulomb(), MaxwellSlip(lengths=LENGTHS))
    values = {"coulomb.hinge": 0.0, "maxwell_slip1.hinge": -1.0,
              "maxwell_slip2.hinge": 0.0, "maxwell_slip3.hinge": 2.0}  # fmt: skip
    assert sum(values.values()) > 0.0
    path = 3e-3 * np.sin(np.linspace(0.0, 2.0 * np.pi, 400))
    assert energy(values, np.tile(path, 4)) < energy(values, np.tile(path, 3))
    assert least(rows, values) < 0.0


def of_dahl(forces: dict[str, float], path: np.ndarray, length: float) -> float:
    """Energy that Dahl friction, and Stribeck friction next to rest, take along a path."""
    state, total = 0.0, 0.0
    for step in np.diff(path):
        sign = np.sign(step)
        after = sign + (state - sign) * np.exp(-abs(step) / length)
        total += forces["dahl.hinge"] * 0.5 * (state + after) * step
        total += forces["stribeck.hinge"] * abs(step)
        state = after
    return total


def test_a_law_of_speed_beside_one_that_remembers_gives_no_energy_in_small_cycles() -> None:
    """Sliding takes energy, but a cycle within the length is the law's of speed alone."""
    length = 3e-3
    rows = rows_of(Dahl(length=length), Viscous(), Stribeck(speed=0.02))
    values = {"dahl.hinge": 3.3, "viscous.hinge": 0.1, "stribeck.hinge": -0.5}
    path = 1e-4 * np.sin(np.linspace(0.0, 2.0 * np.pi, 400))
    assert of_dahl(values, np.tile(path, 6), length) < of_dahl(values, np.tile(path, 5), length)
    assert least(rows, values) < 0.0
    assert least(rows, values | {"stribeck.hinge": 0.1}) >= 0.0


def test_viscous_friction_does_not_hide_a_cycle_that_gives_energy_when_it_is_slow() -> None:
    rows = rows_of(Coulomb(), Viscous(), MaxwellSlip(lengths=LENGTHS))
    values = {"coulomb.hinge": 0.0, "viscous.hinge": 20.0, "maxwell_slip1.hinge": -1.0,
              "maxwell_slip2.hinge": 0.0, "maxwell_slip3.hinge": 2.0}  # fmt: skip
    assert least(rows, values) < 0.0


def test_friction_after_a_turn_is_no_multiple_of_sliding() -> None:
    rows = rows_of(MaxwellSlip(lengths=LENGTHS))
    names = [f"maxwell_slip{k}.hinge" for k in (1, 2, 3)]
    assert least(rows, dict(zip(names, (1.5, 0.0, -0.5), strict=True))) >= 0.0
    assert least(rows, dict(zip(names, (70.0, -110.0, 45.0), strict=True))) < 0.0
    assert least(rows, dict(zip(names, (9.0, 0.0, -8.0), strict=True))) < 0.0


@pytest.mark.parametrize("limit, reached", [(10.0, 10.0), (1e4, 3.0), (1.0, 3.0)])
def test_friction_is_bounded_up_to_the_limit_of_speed(limit: float, reached: float) -> None:
    """A limit far beyond the data is a placeholder; one that the data exceed is none."""
    robot = replace(
        single(), coordinates=(Coordinate("hinge", "revolute", Limits(velocity=limit)),)
    )
    rows = dissipation_rows(Model(robot, (Coulomb(), Quadratic())), [FASTEST])
    values = {"coulomb.hinge": 1.0}
    assert least(rows, values | {"quadratic.hinge": -0.99 / reached**2}) > 0.0
    assert least(rows, values | {"quadratic.hinge": -1.01 / reached**2}) < 0.0
    assert f"up to {reached:.3g} rad/s" in rows[0].label


def test_what_has_no_shape_needs_no_curve() -> None:
    assert rows_of(Coulomb(), Viscous(), Offset()) == ()
    assert rows_of(Dahl(length=1e-3), Viscous()) == ()
    assert rows_of(Coulomb(), Quadratic(per_run=True)) == ()
    assert dissipation_rows(Model(single(), (Coulomb(), Quadratic())), [0.0]) == ()


def test_memory_counts_as_steady_sliding() -> None:
    for law in (Dahl(length=1e-3), LuGre(length=1e-3, breakaway=1.5, speed=0.2)):
        rows = rows_of(law, Quadratic())
        values = {f"{law.law}.hinge": 1.0, "lugre_damping.hinge": 0.0}
        top = 1.0 / (REACH * FASTEST) ** 2
        assert least(rows, values | {"quadratic.hinge": -0.99 * top}) > 0.0
        assert least(rows, values | {"quadratic.hinge": -1.01 * top}) < 0.0


@pytest.mark.parametrize("law", [MaxwellSlip(lengths=LENGTHS), Quadratic()])
def test_rows_of_coupled_motors_are_those_of_each_alone(law: MaxwellSlip | Quadratic) -> None:
    robot = geared()
    assert robot.transmission is not None
    motors, fastest = robot.transmission.motors, [0.5, 1.0, 1.5, 2.0]

    def rows(*names: str) -> list[Row]:
        laws = tuple(replace(one, motors=names) for one in (Coulomb(), law))
        return list(dissipation_rows(Model(robot, laws), fastest))

    alone = [row for name in motors for row in rows(name)]
    for one, other in zip(rows(*motors), alone, strict=True):
        assert (one.label, one.lower) == (other.label, other.lower)
        assert one.coefficients == pytest.approx(other.coefficients, abs=1e-8)


def test_only_laws_of_shape_may_be_negative() -> None:
    model = Model(tree(), (Coulomb(), Viscous(), Quadratic(), Offset()))
    rows = dissipation_rows(model, [1.0] * model.robot.n)
    names = {name for row in rows for name in row.coefficients}
    assert shaped(model, rows) == {n for n in names if n.startswith("quadratic.")}
    assert any(n.startswith("coulomb.") for n in names)


TRUTH = {"coulomb.hinge": 1.0, "viscous.hinge": 2.0, "quadratic.hinge": -0.5}


def model_and_information() -> tuple[Model, Information]:
    """A single joint whose friction grows less than in proportion to speed, with noise."""
    model = Model(single(), (RigidBody(), Coulomb(), Viscous(), Quadratic()))
    rng, t = np.random.default_rng(0), np.arange(0.0, 40.0, 0.01)
    q = np.sin(1.3 * t) + 0.5 * np.sin(2.9 * t + 1.0)
    dq = 1.3 * np.cos(1.3 * t) + 1.45 * np.cos(2.9 * t + 1.0)
    ddq = -1.69 * np.sin(1.3 * t) - 4.205 * np.sin(2.9 * t + 1.0)
    prior = {p.name: p.prior or 0.0 for p in model.parameters} | TRUTH
    valued = model.at(Parameters(model.names, model.units, [prior[n] for n in model.names]))
    effort = valued.torque(Motion(t, q[:, None], dq[:, None], ddq[:, None])).T
    effort = effort + 0.02 * rng.normal(size=effort.shape)
    accumulator = Accumulator(base_regressor(model))
    sums = accumulator(Stretch(q[None], dq[None], ddq[None], effort))
    signature = Signature(model.fingerprint, accumulator.regressor.layout.columns, ("Nm",), "none")
    return model, Information(
        accumulator.regressor.layout, signature, (Window("run", 0.0, 40.0),),
        sums.grams[None], sums.absolute[None], sums.counts[None],
    )  # fmt: skip


def test_a_curve_that_bends_down_is_found() -> None:
    model, information = model_and_information()
    plain = default_knowledge(model)
    rows = dissipation_rows(model, [2.75])
    curved = replace(plain, curves=rows, shaped=shaped(model, rows))

    def values(knowledge: Knowledge) -> dict[str, float]:
        found = Consistent(base_parameters(model), knowledge, gamma=1.0)(information)
        return found.parameters.as_dict()

    found = values(curved)
    for name, wanted in TRUTH.items():
        assert found[name] == pytest.approx(wanted, abs=0.02), name
    assert values(plain)["quadratic.hinge"] == pytest.approx(0.0, abs=1e-6)
    steep = {**found, "quadratic.hinge": -1.5}
    assert least(rows, steep) < 0.0
