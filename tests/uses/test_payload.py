"""Payloads of an invented arm: exact without noise, within their intervals with it."""

from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np
import pytest

from invented import ball
from loaded import GAINS, LOAD, MODEL, REGRESSOR, TOOL, UNITS, run
from steelyard.base.arrays import Z95
from steelyard.base.errors import DataError, ModelError, SteelyardError
from steelyard.estimate.estimate import KnownScales
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.information import Information, Signature
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.estimate.payload.runs_with_payload import drifting
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.uses.payload.payload import payload_headline
from steelyard.uses.payload.payload_fit import fit_payload

NAMES = tuple(f"c{k}" for k in range(9))
SIGNALS = Signals(
    NAMES[0], 1.0, NAMES[1:5], np.ones(4), None, None, NAMES[5:], np.ones(4),
    "motor_current", UNITS, GAINS,
)  # fmt: skip


def model_of(*runs: Information, gains: np.ndarray = GAINS) -> IdentifiedModel:
    """The model that unloaded runs give."""
    information = reduce(add, runs).scaled(gains, MODEL.robot.effort_units)
    return IdentifiedModel(
        MODEL,
        REGRESSOR.base,
        WeightedLeastSquares()(information),
        (),
        replace(SIGNALS, gains=gains),
        Cutoffs(20.0, 8.0, 5.0),
        Provenance("0", {}, (), ()),
    )


EXACT = model_of(run(1))


def test_a_payload_is_recovered_exactly_from_a_model() -> None:
    found = fit_payload(EXACT, [run(2, LOAD)], "tool")
    assert np.abs(found.ten - LOAD.ten).max() < 1e-6
    assert np.abs(found.com - LOAD.com).max() < 1e-6
    assert np.abs(found.inertia_com - LOAD.inertia_com).max() < 1e-6
    assert (found.frame, found.body, found.not_seen, found.weighs) == ("tool", "tip", (), True)


def test_a_payload_is_recovered_exactly_from_runs_together() -> None:
    wrong = model_of(run(1, ball(3)))
    found = fit_payload(wrong, [run(2, LOAD), run(3, LOAD)], "tool", unloaded=[run(4)])
    assert np.abs(found.ten - LOAD.ten).max() < 1e-6
    assert "together" in found.notes[0]


def test_the_frame_of_the_last_link_is_the_default() -> None:
    found = fit_payload(EXACT, [run(2, LOAD)])
    assert (found.frame, found.body) == ("tip", "tip")
    assert np.abs(found.ten - LOAD.moved(TOOL.rotation, TOOL.position).ten).max() < 1e-6


@pytest.mark.parametrize("together", [False, True])
def test_friction_of_another_day_does_not_weigh(together: bool) -> None:
    noisy = model_of(*(run(k, noise=0.05) for k in (1, 2)))
    unloaded = [run(4, noise=0.05)] if together else []
    loaded = [run(3, LOAD, noise=0.05, friction=1.4)]
    free = fit_payload(noisy, loaded, "tool", unloaded=unloaded)
    error = np.abs(free.ten - LOAD.ten)
    assert np.all(error < 2.0 * free.half_width)


def test_friction_offset_and_what_is_per_run_may_drift() -> None:
    terms = (RigidBody(), RotorInertia(per_run=True), Viscous(joints=("tip_joint",)))
    model = Model(MODEL.robot, terms)
    names = [model.names[k] for k in drifting(model, model.names)]
    assert names == [*(f"rotor_inertia.{j}" for j in MODEL.robot.joint_names), "viscous.tip_joint"]


def test_an_empty_hand_weighs_nothing() -> None:
    noisy = model_of(*(run(k, noise=0.3) for k in (1, 2)))
    found = fit_payload(noisy, [run(3, noise=0.3)], "tool")
    assert not found.weighs
    assert abs(found.mass) < 1.5 * found.half_width[0]
    assert found.remarks == ("the interval of the mass contains zero: no payload is detected",)
    assert found.to_dict()["centre"] is None


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    """Noise in the model's runs and in the loaded one; the model is as uncertain as the run."""
    inside = np.zeros(10 + 3 + 9)
    draws = 40
    for draw in range(draws):
        noisy = model_of(run(3 * draw, noise=0.5))
        seed = 3 * draw + 1
        found = fit_payload(noisy, [run(seed, LOAD, noise=0.5, friction=1.1)], "tool")
        errors = (
            (found.ten - LOAD.ten, found.half_width),
            (found.com - LOAD.com, found.com_half_width),
            (found.inertia_com - LOAD.inertia_com, found.inertia_com_half_width),
        )
        inside += np.concatenate([(np.abs(e) <= w).ravel() for e, w in errors])
    shares = inside / draws
    assert 0.90 <= shares[:10].mean() <= 0.99
    assert 0.90 <= shares[10:].mean() <= 0.99


def test_the_delta_method_is_the_slope_of_the_numbers() -> None:
    found = fit_payload(model_of(run(1, noise=0.2)), [run(2, LOAD, noise=0.2)], "tool")
    draws = np.random.default_rng(0).multivariate_normal(found.ten, found.covariance, 20000)
    bodies = [Inertia.from_ten(ten) for ten in draws]
    centre = Z95 * np.std([body.com for body in bodies], axis=0)
    around = Z95 * np.std([body.inertia_com for body in bodies], axis=0)
    assert np.abs(centre / found.com_half_width - 1.0).max() < 0.05
    assert np.abs(around / found.inertia_com_half_width - 1.0).max() < 0.05


def test_what_the_data_do_not_see_is_named() -> None:
    still = {1: 0.3, 3: -0.4}
    found = fit_payload(EXACT, [run(2, LOAD, still=still)], "tip")
    seen = LOAD.moved(TOOL.rotation, TOOL.position).ten
    assert "Ixx" in found.not_seen and "mass" not in found.remarks[0]
    kept = ~np.isnan(found.ten)
    assert kept[0] and np.all(np.abs(found.ten - seen)[kept] < 0.1 * found.half_width[kept])
    assert found.remarks[0].startswith("not identifiable from these data: ")
    assert None in found.to_dict()["ten"]


def test_an_arm_never_seen_moving_without_its_payload_hides_it() -> None:
    posture = {0: 0.2, 1: 0.1, 2: 0.1, 3: 0.2}
    with pytest.raises(
        DataError, match="no parameter of the payload is identifiable from the data"
    ):
        fit_payload(EXACT, [run(2, LOAD)], "left", unloaded=[run(3, still=posture)])


@pytest.mark.slow
def test_intervals_hold_the_error_of_the_gains() -> None:
    inside, exact = [], []
    for seed in range(30):
        wrong = GAINS * (1.0 + 0.02 * np.random.default_rng(seed).standard_normal(4))
        model = model_of(run(2 * seed + 100, noise=0.01), gains=wrong)
        loaded = [run(2 * seed + 101, LOAD, noise=0.01)]
        found, naive = (fit_payload(model, loaded, "tool", gain=g) for g in (0.02, 0.0))
        assert abs(found.mass - naive.mass) < 0.5 * found.half_width[0]
        inside.append(abs(found.mass - LOAD.mass) <= found.half_width[0])
        exact.append(abs(found.mass - LOAD.mass) <= naive.half_width[0])
    assert np.mean(inside) >= 0.87 and np.mean(exact) < 0.6


SPREAD = 0.05**2 * np.ones((4, 4)) + 0.01**2 * np.eye(4)
"""Scales that have an error in common."""


@pytest.mark.slow
@pytest.mark.parametrize("together", [False, True])
def test_intervals_hold_the_error_of_scales_of_any_unit(together: bool) -> None:
    inside, exact = [], []
    for seed in range(12):
        logs = np.random.default_rng(seed).multivariate_normal(np.zeros(4), SPREAD)
        model = model_of(run(3 * seed + 100, noise=0.01), gains=GAINS * np.exp(logs))
        model = replace(model, signals=replace(model.signals, effort_units=("Nm",) * 4))
        scaled = replace(model, effort_scales=KnownScales(model.joints, np.ones(4), SPREAD))
        loaded = [run(3 * seed + 101, LOAD, noise=0.01)]
        unloaded = [run(3 * seed + 102, noise=0.01)] if together else []
        found, naive = (
            fit_payload(some, loaded, "tool", unloaded=unloaded, gain=gain)
            for some, gain in ((scaled, None), (model, 0.0))
        )
        assert abs(found.mass - naive.mass) < 0.5 * found.half_width[0]
        inside.append(abs(found.mass - LOAD.mass) <= found.half_width[0])
        exact.append(abs(found.mass - LOAD.mass) <= naive.half_width[0])
        assert "a common scale error of 1 %" in naive.notes[-1]
        assert f"± {found.half_width[0]:.2g} kg" in found.notes[-1]
    assert np.mean(inside) >= 0.88 and np.mean(exact) < 0.6


def test_scales_say_how_well_gains_are_known() -> None:
    scales = KnownScales(EXACT.joints, np.ones(4), SPREAD)
    scaled = replace(model_of(run(1, noise=0.01)), effort_scales=scales)
    loaded = [run(2, LOAD, noise=0.01)]
    alone, beside = (fit_payload(scaled, loaded, "tool", gain=gain) for gain in (None, 0.04))
    assert alone.half_width[0] == pytest.approx(Z95 * 0.05 * LOAD.mass, rel=0.05)
    assert beside.half_width[0] > 1.05 * alone.half_width[0]
    assert "uncertainty of 4 %" in beside.notes[-1] and "drive gain" not in alone.notes[-1]


def test_what_the_model_lacks_widens_the_intervals() -> None:
    plain = [run(2, LOAD, noise=0.05)]
    heavier = run(3, LOAD + ball(4), noise=0.05)
    apart, alike = (
        fit_payload(EXACT, [*plain, other], "tool", gain=0.0)
        for other in (heavier, run(3, LOAD, noise=0.05))
    )
    assert apart.half_width[0] > 2.0 * alike.half_width[0]


def test_remarks_tell_a_seen_inertia_from_a_poor_one() -> None:
    good = fit_payload(EXACT, [run(2, LOAD, noise=0.01)], "tool", gain=0.0)
    assert (
        good.remarks[0]
        == "the inertia is identified: no interval of a moment of inertia contains zero"
    )
    poor = fit_payload(model_of(run(1, noise=2.0)), [run(2, LOAD, noise=2.0)], "tool")
    assert poor.remarks[0].startswith("the inertia is poorly identified: the interval of ")


def test_a_body_that_cannot_be_is_reported() -> None:
    ten = np.array([1.0, 0.0, 0.0, 0.0, -0.1, 0.0, 0.2, 0.0, 0.0, 0.2])
    found = PayloadEstimate("f", "b", ten, 1e-6 * np.eye(10), np.ones(1), np.ones(1))
    assert found.flaw == "a principal moment of inertia is negative (-0.1 kg m²)"
    assert (
        "Ixx have intervals entirely below zero, which is physically impossible" in found.remarks[0]
    )
    assert found.to_dict()["consistent_body"] is False and found.to_dict()["flaw"] == found.flaw
    assert fit_payload(EXACT, [run(2, LOAD)], "tool").to_dict()["consistent_body"] is True


def test_a_payload_is_printed_with_its_intervals() -> None:
    found = fit_payload(EXACT, [run(2, LOAD, noise=0.01)], "tool")
    first, mass, centre, *rest = str(found).splitlines()
    assert first == "payload in frame 'tool', with 95 % intervals"
    assert mass == f"mass    {found.mass:.4g} ± {found.half_width[0]:.2g} kg"
    assert centre.startswith(f"centre  {found.com[0]:.4g} ± {found.com_half_width[0]:.2g} m, ")
    assert rest[: len(found.remarks)] == list(found.remarks)
    assert repr(found) == f"PayloadEstimate({mass.removeprefix('mass    ')} on 'tool')"
    blind = PayloadEstimate("f", "b", np.full(10, np.nan), np.eye(10), np.ones(1), np.ones(1))
    assert "mass    not identifiable" in str(blind)


def test_a_noisy_payload_is_a_body_that_can_exist() -> None:
    found = fit_payload(model_of(run(1, noise=2.0)), [run(2, LOAD, noise=2.0)], "tool")
    assert found.flaw is None and found.to_dict()["consistent_body"] is True
    assert found.chi_squared > 0.0


def test_gains_too_small_ask_for_a_negative_mass() -> None:
    weaker = replace(EXACT, signals=replace(SIGNALS, gains=0.8 * GAINS))
    found = fit_payload(weaker, [run(2, noise=0.01)], "tool")
    assert found.negative_mass is not None and found.negative_mass < 0.0 <= found.mass
    assert f"a negative mass of about {found.negative_mass:.2g} kg: gains, tool" in found.remarks[1]
    assert found.remarks[0] == found.unexplained != ""
    assert payload_headline(found).startswith(
        "No payload: the data ask for a negative mass of about -"
    )
    assert found.to_dict()["negative_mass"] == found.negative_mass
    right = fit_payload(EXACT, [run(2, LOAD, noise=0.01)], "tool")
    assert right.negative_mass is None and "negative" not in " ".join(right.remarks)


def test_a_large_cost_of_the_physical_constraint_is_reported() -> None:
    """No noise explains what errors of a model do to moments of inertia."""
    odd = Inertia.about_com(LOAD.mass, LOAD.com, -0.3 * np.eye(3))
    found = fit_payload(EXACT, [run(2, odd, noise=0.05)], "tool", gain=0.0)
    assert found.flaw is None
    assert found.chi_squared > 18.3 and "raises χ²" in found.remarks[-1]
    assert found.to_dict()["chi_squared_rise"] == found.chi_squared


@pytest.mark.parametrize(
    ("frame", "words"),
    [("tol", "did you mean 'tool'?"), ("flange_of_base", "fixed to the base")],
)
def test_frames_that_cannot_carry(frame: str, words: str) -> None:
    with pytest.raises(ModelError) as caught:
        fit_payload(EXACT, [run(2, LOAD)], frame)
    assert words in str(caught.value)


def foreign(information: Information, **fields: object) -> Information:
    signature = Signature(**{**vars(information.signature), **fields})  # type: ignore[arg-type]
    return Information(**{**vars(information), "signature": signature})


def refusal(*args: object, **options: object) -> SteelyardError:
    with pytest.raises(DataError) as caught:
        fit_payload(EXACT, *args, **options)  # type: ignore[arg-type]
    return caught.value


def test_runs_of_another_kind_are_refused() -> None:
    assert "another model" in str(refusal([foreign(run(2), model="x")]))
    mixed = [run(2, LOAD), foreign(run(3, LOAD), filters="8 Hz")]
    assert "unequal filters" in str(refusal(mixed))
    assert "no run with the payload" in str(refusal([]))
    assert "drive gains is 2" in str(refusal([run(2)], gain=2.0))
    assert "the run has no usable samples" in str(refusal([run(2).of(())]))
