"""Drive gains of an invented arm: exact without noise, unbiased and within intervals with it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import add
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from loaded import GAINS, LOAD, MODEL, TOOL, UNITS, run
from steelyard.base.errors import DataError, ModelError, SteelyardError
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.payload.drive_gains import Bilinear, identified_gains
from steelyard.estimate.payload.runs_with_payload import _scatter, carrier, load_case

JOINTS = MODEL.robot.joint_names
UNLOADED, LOADED = [run(1)], [run(2, LOAD, friction=1.4)]


def relative(found: np.ndarray) -> float:
    """Largest relative error of gains."""
    return float(np.abs(found / GAINS - 1.0).max())


def test_a_known_mass_gives_all_gains_signs_included() -> None:
    found = identified_gains(MODEL, UNLOADED, LOADED, mass=LOAD.mass, frame="tool")
    assert relative(found.gains) < 1e-6
    assert found.payload is not None
    assert np.abs(found.payload.ten - LOAD.ten).max() < 1e-6
    assert found.payload.half_width[0] == 0.0
    assert (found.joints, found.known, found.relative) == (JOINTS, (False,) * 4, False)
    assert found.units == ("Nm/A", "N/A", "1", "Nm/A")
    assert set(UNITS) == {"A", "Nm"}


def test_a_known_gain_gives_the_others_and_weighs() -> None:
    known = {JOINTS[1]: GAINS[1]}
    without = identified_gains(MODEL, UNLOADED, known=known)
    assert relative(without.gains) < 1e-6
    assert without.payload is None and without.known == (False, True, False, False)
    assert np.all(without.covariance[1] == 0.0)
    found = identified_gains(MODEL, UNLOADED, LOADED, known=known, frame="tool")
    assert found.payload is not None
    assert np.abs(found.payload.ten - LOAD.ten).max() < 1e-6
    assert found.payload.half_width[0] > 0.0


def test_a_known_gain_is_kept_however_small() -> None:
    small = GAINS * [1.0, 1.0, 1e-6, 1.0]
    runs = [run(1, gains=small)]
    found = identified_gains(MODEL, runs, known={JOINTS[2]: 1e-6})
    assert np.abs(found.gains / small - 1.0).max() < 1e-6


def test_all_gains_known_leaves_them() -> None:
    known = dict(zip(JOINTS, GAINS.tolist(), strict=True))
    found = identified_gains(MODEL, UNLOADED, LOADED, known=known, frame="tool")
    assert np.array_equal(found.gains, GAINS) and not found.covariance.any()
    assert found.payload is not None
    assert np.abs(found.payload.ten - LOAD.ten).max() < 1e-6


def test_gains_up_to_one_scale() -> None:
    found = identified_gains(MODEL, UNLOADED, relative=True)
    assert found.relative and found.gains[0] == 1.0
    assert np.abs(found.gains / (GAINS / GAINS[0]) - 1.0).max() < 1e-6
    scaled = identified_gains(MODEL, UNLOADED, LOADED, mass=LOAD.mass, frame="tool", relative=True)
    assert not scaled.relative and relative(scaled.gains) < 1e-6


def noisy(draw: int, noise: float) -> tuple[list[Information], list[Information]]:
    first, second = run(2 * draw, noise=noise), run(2 * draw + 1, LOAD, noise, friction=0.7)
    return [first], [second]


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    draws, inside, masses = 15, np.zeros(4), 0
    for draw in range(draws):
        found = identified_gains(MODEL, *noisy(draw, 0.5), mass=LOAD.mass, frame="tool")
        inside += np.abs(found.gains - GAINS) <= found.half_width
        other = identified_gains(MODEL, *noisy(draw, 0.5), known={JOINTS[0]: 12.0}, frame="tool")
        assert other.payload is not None
        masses += abs(other.payload.mass - LOAD.mass) <= other.payload.half_width[0]
    assert 0.90 <= inside.mean() / draws <= 0.99
    assert 0.84 <= masses / draws


@pytest.mark.slow
def test_intervals_hold_the_truth_where_residuals_are_alike_for_long() -> None:
    """Runs of eight windows in which every sample is there thirty times: with its error, too."""
    draws, inside = 12, np.zeros(4)
    for draw in range(draws):
        unloaded, loaded = (
            repeated([run(100 * draw + 10 * k + w, load, 1.0, count=25) for w in range(8)], k)
            for k, load in enumerate((None, LOAD))
        )
        found = identified_gains(MODEL, [unloaded], [loaded], mass=LOAD.mass, frame="tool")
        inside += np.abs(found.gains - GAINS) <= found.half_width
    assert 0.85 <= inside.mean() / draws <= 0.99


def repeated(parts: Sequence[Information], number: int) -> Information:
    """One run of these windows, every sample thirty times."""
    windows = tuple(Window(f"run{number}", float(k), k + 1.0) for k in range(len(parts)))
    return replace(reduce(add, parts).with_effective_samples(1.0 / 30.0), windows=windows)


@pytest.mark.slow
def test_a_gain_that_is_hardly_seen_is_assumed() -> None:
    """An interval of half of the gain and more is not that of its inverse, which is linear."""
    for draw in range(6):
        found = identified_gains(MODEL, [run(draw, noise=3.0)], known={JOINTS[0]: GAINS[0]})
        seen = ~np.array(found.assumed) & ~np.array(found.known)
        assert np.all(found.half_width[seen] <= 0.5 * np.abs(found.gains[seen]))


def start(unloaded: Sequence[Information], loaded: Sequence[Information]) -> np.ndarray:
    """Gains on the side of the parameters: noisy efforts among the columns."""
    frame = carrier(MODEL.robot, "tool")
    case = load_case(MODEL, base_parameters(MODEL), frame, unloaded, loaded, first_deviates=False)
    return 1.0 / Bilinear.of(case, LOAD.mass, np.full(4, np.nan), True).first()


@pytest.mark.slow
def test_noise_does_not_bias_gains_as_it_does_with_efforts_among_the_columns() -> None:
    found, biased = [], []
    for draw in range(12):
        unloaded, loaded = noisy(draw, 4.0)
        gains = identified_gains(MODEL, unloaded, loaded, mass=LOAD.mass, frame="tool").gains
        found.append(gains / GAINS - 1.0)
        biased.append(start(unloaded, loaded) / GAINS - 1.0)
    spread = np.std(found, axis=0) / np.sqrt(len(found))
    assert np.all(np.abs(np.mean(found, axis=0)) < 4.0 * spread)
    assert np.min(np.mean(biased, axis=0)) < -0.15


def problem(runs: Sequence[Information], laws: frozenset[str]) -> Bilinear:
    frame = carrier(MODEL.robot, None)
    case = load_case(MODEL, base_parameters(MODEL), frame, runs, (), first_deviates=False)
    return Bilinear.of(case, None, np.array([12.0, *[np.nan] * 3]), False, laws)


FRICTION = frozenset(f"{law}.{name}" for law in ("coulomb", "viscous") for name in JOINTS)


@pytest.mark.slow
def test_friction_tells_the_sign_of_a_gain_where_bodies_hardly_do() -> None:
    """A last joint that hardly couples: its gain is poorly seen, but friction takes energy."""
    for draw in range(6):
        turned = GAINS * [1.0, 1.0, 1.0, -1.0]
        runs = [run(draw, noise=2.0, gains=turned, friction=8.0)]
        found = problem(runs, FRICTION)
        np.testing.assert_array_equal(found.signs, np.sign(turned))
        gains = identified_gains(MODEL, runs, known={JOINTS[0]: 12.0}).gains
        np.testing.assert_array_equal(np.sign(gains), np.sign(turned))


def test_friction_that_is_not_there_or_not_seen_alone_tells_no_sign() -> None:
    assert not problem([run(1, noise=2.0, friction=0.0)], FRICTION).signs.any()
    assert not problem([run(1, noise=2.0)], frozenset()).signs.any()
    still = problem([run(1, noise=0.1, still={3: 0.4})], FRICTION)
    assert still.signs[3] == 0.0 and np.all(still.signs[:3] == np.sign(GAINS[:3]))


def refusal(kind: type[SteelyardError], *args: object, **options: object) -> str:
    with pytest.raises(kind) as caught:
        identified_gains(MODEL, *args, **options)  # type: ignore[arg-type]
    return str(caught.value)


def test_questions_without_an_answer() -> None:
    words = refusal(DataError, UNLOADED)
    assert "identifiable only relative to each other" in words
    assert "the payload's mass" in words and "the gain of one joint" in words
    assert "relative to each other" in refusal(DataError, UNLOADED, LOADED)
    assert "there is none without" in refusal(DataError, [], LOADED, mass=1.7)
    assert "there is none with" in refusal(DataError, UNLOADED, [], mass=1.7)
    assert "mass is -2 kg" in refusal(DataError, UNLOADED, LOADED, mass=-2.0)
    assert "there is no run" in refusal(DataError, [], known={JOINTS[0]: 1.0})


def test_names_and_values_of_known_gains() -> None:
    words = refusal(ModelError, UNLOADED, known={"tpi_joint": 2.0})
    assert "there is no joint 'tpi_joint'" in words and "'tip_joint'" in words
    assert "the gain of joint 'trunk_joint' is 0" in refusal(
        ModelError, UNLOADED, known={"trunk_joint": 0.0}
    )
    assert "no frame 'tol'" in refusal(ModelError, UNLOADED, LOADED, mass=1.0, frame="tol")


def test_a_gain_that_nothing_shows_is_assumed_to_be_as_those_of_its_unit() -> None:
    """A branch that moves alone shares no parameter with the other joints."""
    still = {0: 0.3, 1: 0.1, 3: 0.2}
    known = {"trunk_joint": 12.0, "slider_joint": 5.0, "left_joint": 1.0}
    found = identified_gains(MODEL, [run(1, still=still)], known=known)
    assert found.assumed == (False, False, False, True) and not found.known[3]
    assert found.gains[3] == pytest.approx(12.0) and found.covariance[3, 3] == 0.0
    assert found.to_dict()["assumed"] == list(found.assumed)


def test_a_gain_that_nothing_shows_is_named_where_no_other_is_of_its_unit() -> None:
    still = {0: 0.3, 1: 0.1, 3: 0.2}
    words = refusal(DataError, [run(1, still=still)], known={"slider_joint": 12.0})
    assert "the data do not determine the gain of joint '" in words
    assert "or give its gain" in words


def test_a_gain_behind_much_noise_is_named_with_its_interval() -> None:
    runs = [run(1, noise=60.0)], [run(2, LOAD, noise=60.0)]
    words = refusal(DataError, *runs, mass=LOAD.mass, frame="tool")
    assert "95 % interval of ±" in words


def test_the_body_that_carries_matters_not_the_frame() -> None:
    there = LOAD.moved(TOOL.rotation, TOOL.position)
    found = identified_gains(MODEL, UNLOADED, LOADED, mass=LOAD.mass)
    assert found.payload is not None and found.payload.frame == "tip"
    assert np.abs(found.payload.ten - there.ten).max() < 1e-6


@pytest.mark.parametrize("windows", [2, 8])
def test_scatter_of_scores_is_known_as_well_as_chance_says(windows: int) -> None:
    """White residuals scatter by the factor 1; the fit takes much of the scores of few windows."""
    rng, samples, draws = np.random.default_rng(3), 40, 1500
    columns = rng.normal(size=(windows, samples, 12)) * rng.uniform(0.3, 2.0, (windows, 1, 12))
    covariance = np.linalg.inv(np.einsum("wka,wkb->ab", columns, columns))
    factors = []
    for effort in rng.normal(size=(draws, windows, samples)):
        rows = np.concatenate((columns, effort[..., None]), axis=-1)
        grams = rows.swapaxes(1, 2) @ rows
        seen = SimpleNamespace(
            layout=SimpleNamespace(sees=(tuple(range(12)),)),
            row_grams=lambda row, grams=grams: grams,
            windows=range(windows),
        )
        values = covariance @ np.einsum("wka,wk->a", columns, effort)
        found, chance = _scatter(cast(Any, seen), values, np.ones(1), covariance)
        factors.append(float(found[0]))
    assert np.mean(factors) == pytest.approx(1.0, abs=0.05)
    assert np.std(factors) == pytest.approx(float(chance[0]), rel=0.1)
