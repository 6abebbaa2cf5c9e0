"""`friction = "auto"`: the staging rule on invented errors, and the choice on simulated logs."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from invented import single
from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.estimate.friction.friction_choice import FrictionChoice, _staged, choose_friction
from steelyard.estimate.friction.friction_mixes_and_curves import mix_name
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.scores.cross_validation import logarithms
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    Cubic,
    DirectionalCoulomb,
    DirectionalStribeck,
    Root,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent, MaxwellSlip
from steelyard.model.laws.laws_without_friction import Offset, RigidBody
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import Term, has_memory
from steelyard.robot.file.sections import EffortKind
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run

PLAIN, SMOOTH, SPRING = (Coulomb(),), (Coulomb(smoothing=0.02),), (Dahl(length=1e-3),)
SPEED = ((Viscous(),), (Viscous(), Root()), (Viscous(), Cubic()))
STAGES = ((PLAIN, SMOOTH, SPRING), SPEED)


def chosen(percent: Mapping[str, list[float]], stages: object = STAGES) -> FrictionChoice:
    """The choice for errors per fold [%] of mixes by name; those of others are bad."""
    tried = []

    def errors(mix: tuple[Term, ...]) -> np.ndarray:
        tried.append(mix)
        return np.log(percent.get(mix_name(mix), [50.0, 51.0, 52.0]))

    judge = SimpleNamespace(
        errors=errors, per_joint=lambda following: [], plausible=lambda kept, laws: laws
    )
    found = _staged(stages, judge, "run")  # type: ignore[arg-type]
    assert [mix.terms for mix in found.table] == list(dict.fromkeys(tried))
    return found


BASE = "coulomb + viscous"
SMOOTHED = "coulomb (smoothing 0.02) + viscous"
DAHL = "dahl (length 0.001) + viscous"


def test_the_best_is_taken_where_every_run_gains() -> None:
    found = chosen({BASE: [10.0, 12.0, 14.0], SMOOTHED: [9.0, 11.0, 13.0], DAHL: [5.0, 6.0, 7.0]})
    assert found.best.terms == (Dahl(length=1e-3), Viscous()) and found.best.name == DAHL
    assert [mix.chosen for mix in found.table].count(True) == 1
    best = next(mix for mix in found.table if mix.chosen)
    assert best.error == pytest.approx((5.0 * 6.0 * 7.0) ** (1.0 / 3.0))
    assert best.gain == pytest.approx(50.0)
    assert best.spread == pytest.approx(0.0, abs=1e-9)
    assert BASE in found.note and "leaving one run out" in found.note


def test_a_simpler_mix_is_preferred_within_the_spread_of_the_gain() -> None:
    """The spring is better on average, by one lucky run."""
    found = chosen({BASE: [10.0, 10.0, 10.0], DAHL: [10.2, 10.2, 6.0], SMOOTHED: [11.0, 9.5, 10.0]})
    assert found.best.name == BASE
    spring = next(mix for mix in found.table if mix.name == DAHL)
    assert spring.error < found.table[0].error and spring.gain > 0.0
    logs = np.log([1.02, 1.02, 0.6])
    wanted = 100.0 * np.exp(logs.mean()) * logs.std(ddof=1) / np.sqrt(3.0)
    assert spring.spread == pytest.approx(wanted)


def test_of_laws_that_take_each_others_place_the_best_is_taken() -> None:
    found = chosen({BASE: [20.0, 20.0, 20.0], SMOOTHED: [10.0, 10.0, 10.0], DAHL: [9.0, 9.9, 10.2]})
    assert found.best.name == DAHL
    found = chosen({BASE: [20.0] * 3, SMOOTHED: [10.0] * 3, DAHL: [9.97, 9.98, 9.99]})
    assert found.best.name == SMOOTHED


def test_one_sure_gain_is_enough_where_the_best_scatters() -> None:
    """The least error is that of a law whose gain scatters; another one's gain is beyond doubt."""
    found = chosen({BASE: [2.0, 2.1, 2.2], SMOOTHED: [1.8, 1.9, 2.0], DAHL: [1.0, 2.2, 1.1]})
    assert found.best.name.startswith("dahl")
    alone = chosen({BASE: [2.0, 2.1, 2.2], DAHL: [1.0, 2.2, 1.1]})
    assert alone.best.name == BASE


def test_what_is_added_must_gain_more_than_its_spread() -> None:
    cubic, root = f"{BASE} + cubic", f"{BASE} + root"
    found = chosen({BASE: [10.0] * 3, root: [10.2, 9.9, 8.0], cubic: [30.0] * 3})
    assert found.best.name == BASE
    found = chosen({BASE: [10.0] * 3, root: [9.0, 8.9, 8.8], cubic: [8.9, 9.3, 7.9]})
    assert found.best.name == root


def test_later_stages_build_on_what_was_chosen() -> None:
    cubic = f"{DAHL} + cubic"
    found = chosen({BASE: [10.0] * 3, DAHL: [5.0] * 3, cubic: [4.0] * 3})
    assert found.best.name == cubic
    names = [mix.name for mix in found.table]
    assert names == [BASE, SMOOTHED, DAHL, f"{DAHL} + root", cubic]
    stages = (*STAGES, ((), (Stribeck(speed=0.2),)))
    more = f"{BASE} + stribeck (speed 0.2)"
    found = chosen({BASE: [10.0] * 3, more: [9.0] * 3}, stages)
    assert found.best.name == more
    assert found.table[-1].chosen and found.table[-1].gain == pytest.approx(10.0)


def test_scatter_does_not_speak_for_a_mix() -> None:
    found = chosen({BASE: [10.0] * 3, SMOOTHED: [6.0, 8.0, 60.0], DAHL: [8.0] * 3})
    assert found.best.name == DAHL


def test_one_fold_has_no_spread() -> None:
    found = chosen({BASE: [10.0], SMOOTHED: [9.8], DAHL: [20.0],
                    f"{SMOOTHED} + root": [9.9], f"{SMOOTHED} + cubic": [11.0]})  # fmt: skip
    assert found.best.name == SMOOTHED


def test_a_gain_of_next_to_nothing_is_not_worth_another_law() -> None:
    found = chosen({BASE: [10.0] * 3, SMOOTHED: [9.96] * 3, DAHL: [20.0] * 3})
    assert found.best.name == BASE


def test_the_choice_as_json() -> None:
    printed = chosen({BASE: [10.0] * 3, SMOOTHED: [8.0] * 3}).to_dict()
    assert (printed["chosen"], printed["left_out"]) == (SMOOTHED, "run")
    assert [row["mix"] for row in printed["table"] if row["chosen"]] == [SMOOTHED]
    assert printed["table"][0]["error_percent"] == pytest.approx(10.0)
    assert printed["table"][1]["gain_percent"] == pytest.approx(20.0)


def test_names_say_what_is_not_usual() -> None:
    assert mix_name((Coulomb(), Viscous(joints=("hinge",)))) == "coulomb + viscous"
    relaxing = MaxwellSlip(lengths=(0.01, 0.1), relaxing=True)
    assert mix_name((relaxing,)) == "maxwell_slip (lengths 0.01, 0.1, relaxing)"
    assert mix_name((Coulomb(smoothing=0.005),)) == "coulomb (smoothing 0.005)"
    assert has_memory((Coulomb(), Dahl(length=1e-3))) and not has_memory((Coulomb(), Viscous()))


def test_one_figure_is_between_the_typical_joint_and_all_together() -> None:
    errors, sizes = np.array([[10.0, 40.0], [5.0, 5.0]]), np.array([[9.0, 1.0], [1.0, 1.0]])
    pooled = np.sqrt((9.0 * 100.0 + 1600.0) / 10.0)
    wanted = [np.sqrt(np.sqrt(10.0 * 40.0) * pooled), 5.0]
    np.testing.assert_allclose(np.exp(logarithms(errors, sizes)), wanted)


MODEL = Model(single(), (RigidBody(),))
RATE = 100.0


def truth(*laws: Term, values: Mapping[str, float]) -> ValuedModel:
    model = Model(single(), (RigidBody(), *laws))
    prior = {p.name: p.prior or 0.0 for p in model.parameters}
    known = {**prior, **values}
    return model.at(Parameters(model.names, model.units, [known[n] for n in model.names]))


def logged(valued: ValuedModel, seed: int, duration: float = 40.0) -> Run:
    """Slow swings with many reversals, small ones too; torque noise of 0.02 Nm."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / RATE)
    states = np.zeros((3, len(t)))
    for w, size in ((0.6, 0.8), (2.1, 0.25), (5.3, 0.02)):
        phase, w = rng.uniform(0.0, 6.0), w * rng.uniform(0.9, 1.1)
        s, c = size * np.sin(w * t + phase), size * np.cos(w * t + phase)
        states += [s, w * c, -w * w * s]
    q, dq, ddq = states
    torque = valued.torque(Motion(t, q[:, None], dq[:, None], ddq[:, None]))[:, 0]
    effort = torque + 0.02 * rng.normal(size=len(t))
    one = np.ones(1)
    signals = Signals("t", 1.0, ("q",), one, ("v",), one, ("e",), one, "joint_torque", ("Nm",), one)
    table = np.column_stack([t, q, dq, effort])
    log = LogInMemory(Path(f"run{seed}"), ("t", "q", "v", "e"), table)
    return prepare(Recording(log, signals), Processing(20.0, 8.0))


def with_kind(run: Run, kind: EffortKind) -> Run:
    """The same run, its effort called another kind."""
    signals = replace(run.recording.signals, effort_kind=kind)
    return replace(run, recording=replace(run.recording, signals=signals))


COULOMB = truth(Coulomb(), Viscous(), values={"coulomb.hinge": 1.0, "viscous.hinge": 0.6})
SPRUNG = truth(Dahl(length=1e-2), Viscous(), values={"dahl.hinge": 1.0, "viscous.hinge": 0.6})


def choose(valued: ValuedModel, count: int) -> FrictionChoice:
    runs = [logged(valued, seed) for seed in range(count)]
    return choose_friction(MODEL, runs, WeightedLeastSquares())


def fresh_error(laws: tuple[Term, ...], runs: list[Run], fresh: Run) -> float:
    """Residual of a run that was not fitted, relative to its effort."""
    regressor = base_regressor(Model(single(), (RigidBody(), *laws)))
    fitted, tested = information_from(runs)(regressor), information_from([fresh])(regressor)
    known = WeightedLeastSquares()(fitted).parameters.as_dict()
    values = np.array([known.get(name, 0.0) for name in regressor.layout.columns])
    return float(np.sqrt(tested.residual_squares(values)[0] / tested.effort_squares()[0]))


@pytest.mark.slow
def test_plain_friction_gets_the_plain_mix() -> None:
    found = choose(COULOMB, 5)
    assert found.left_out == "run" and found.table[0].name == BASE
    assert found.best.name == BASE
    assert all(mix.error > 0.995 * found.table[0].error for mix in found.table)


@pytest.mark.slow
def test_the_choice_is_not_worse_than_the_plain_mix_on_a_fresh_run() -> None:
    for valued in (COULOMB, SPRUNG):
        runs, fresh = [logged(valued, seed) for seed in range(2)], logged(valued, 10)
        laws = choose_friction(MODEL, runs, WeightedLeastSquares()).best.terms
        errors = [fresh_error(mix, runs, fresh) for mix in (laws, (Coulomb(), Viscous()))]
        assert errors[0] < 1.01 * errors[1]


def test_a_presliding_spring_gets_a_law_with_memory() -> None:
    found = choose(SPRUNG, 1)
    assert found.left_out == "segment"
    assert has_memory(found.best.terms)
    best = next(mix for mix in found.table if mix.chosen)
    assert best.error < 0.8 * found.table[0].error
    assert Dahl(length=1e-2) in found.best.terms


def test_friction_that_differs_between_directions_in_size_and_with_speed_is_found() -> None:
    laws = (DirectionalCoulomb(), Viscous(), DirectionalStribeck(speed=0.1))
    sizes = {"coulomb": (1.0, 0.7), "stribeck": (0.7, 0.1)}
    values = {
        f"directional_{name}_{way}.hinge": size
        for name, pair in sizes.items()
        for way, size in zip(("forward", "backward"), pair, strict=True)
    }
    valued = truth(*laws, values={"viscous.hinge": 0.6} | values)
    runs = [logged(valued, seed) for seed in range(3)]
    found = choose_friction(MODEL, runs, WeightedLeastSquares())
    assert DirectionalStribeck(speed=0.1) in found.best.terms
    with_offset = replace(MODEL, terms=(*MODEL.terms, Offset()))
    found = choose_friction(with_offset, runs, WeightedLeastSquares())
    assert DirectionalStribeck(speed=0.1) in found.best.terms
    assert not any("directional_coulomb" in mix.name for mix in found.table)


def test_laws_with_a_state_are_left_out_on_request() -> None:
    runs = [with_kind(logged(SPRUNG, seed), "motor_torque") for seed in range(2)]
    found = choose_friction(MODEL, runs, WeightedLeastSquares(), memory=False)
    assert len(found.table) > 4 and not any(has_memory(mix.terms) for mix in found.table)
    assert found.without_memory is None


@pytest.mark.slow
def test_only_motors_have_friction_that_grows_with_the_load() -> None:
    assert not any("load" in mix.name for mix in choose(COULOMB, 2).table)
    runs = [with_kind(logged(COULOMB, seed), "motor_torque") for seed in range(2)]
    found = choose_friction(MODEL, runs, WeightedLeastSquares())
    loads = [mix for mix in found.table if "load" in mix.name]
    assert len(loads) == 1 and loads[0] is found.table[-2]
    assert any(term.law == LoadDependent.law for term in loads[0].terms)


def test_a_run_too_short_is_refused() -> None:
    with pytest.raises(DataError) as caught:
        choose_friction(MODEL, [logged(COULOMB, 0, 1.7)], WeightedLeastSquares())
    assert "too short to leave a part of it out" in caught.value.wrong
    assert "name the friction laws" in caught.value.fix
