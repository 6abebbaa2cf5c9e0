"""Every key of `[excitation.criterion]`, and what an earlier log changes, against plain NumPy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.tabled import OPEN, arm, designed, model_with_open_friction, problem_of
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.excite.design_problem_and_information import Earlier, Problem

ANY = f'{OPEN}[excitation.limits]\neffort = "any"\n'
QUICK = "[excitation.motion]\nperiod = 4.0\nharmonics = 3\n"


def earlier(folder: Path, blind: int = 0, size: float = 1.0) -> Earlier:
    """An earlier estimate of the arm's values, without the last base parameters."""
    model = model_with_open_friction(arm(folder))
    base, random = base_parameters(model), np.random.default_rng(3)
    standard = {p.name: 0.3 if p.prior is None else size * p.prior for p in model.parameters}
    values = base.base_values([standard[name] for name in model.names])
    seen = len(base) - blind
    root = 0.02 * random.standard_normal((seen, seen))
    return Earlier(
        noise=np.array([0.5, 1.0, 0.25]),
        cutoff=8.0,
        names=base.base_names[:seen],
        values=values[:seen],
        covariance=root @ root.T + 1e-4 * np.eye(seen),
        standard=standard,
    )


def gram_of(problem: Problem, x: Array, weights: Array) -> Array:
    """Information by differences of torque, sample by sample."""
    (case, *_) = problem.cases
    model, base = case.shows.model, case.shows.base
    t = np.linspace(0.0, problem.basis.duration, problem.samples, endpoint=False)
    motion = problem.basis.motion(x).sample(t)
    lift = np.zeros((len(model.names), len(base)))
    for k, name in enumerate(base.base_names):
        lift[model.names.index(name), k] = 1.0
    columns = np.stack(
        [
            model.at(model_values(problem, lift[:, k])).torque(motion).reshape(-1)
            for k in range(len(base))
        ],
        axis=1,
    )
    step = problem.basis.duration / problem.samples
    scale = np.sqrt(np.tile(weights * step, len(t)))
    return (columns * scale[:, None]).T @ (columns * scale[:, None])


def model_values(problem: Problem, values: Array):  # type: ignore[no-untyped-def]
    from steelyard.base.arrays import Parameters

    model = problem.cases[0].shows.model
    return Parameters(model.names, model.units, values)


def drawn(problem: Problem) -> Array:
    return 0.3 * np.random.default_rng(1).standard_normal((3, problem.basis.count))


def normalised(gram: Array) -> Array:
    size = np.sqrt(np.diagonal(gram))
    return gram / size[:, None] / size


FIGURES = {
    "condition": lambda g: np.sqrt(np.linalg.cond(g)),
    "normalised_condition": lambda g: np.sqrt(np.linalg.cond(normalised(g))),
    "d_optimal": lambda g: np.linalg.det(g) ** (-1.0 / len(g)),
    "a_optimal": lambda g: np.trace(np.linalg.inv(g)),
    "e_optimal": lambda g: 1.0 / np.linalg.eigvalsh(g)[0],
}


@pytest.mark.parametrize("kind", FIGURES)
def test_kinds(tmp_path: Path, kind: str) -> None:
    problem = problem_of(tmp_path, f'{ANY}{QUICK}[excitation.criterion]\nkind = "{kind}"\n')
    x = drawn(problem)
    gram = gram_of(problem, x, np.ones(3))
    assert problem.criterion_value(x) == pytest.approx(FIGURES[kind](gram), rel=1e-6)


def test_weights_of_the_joints(tmp_path: Path) -> None:
    tables = f'{ANY}{QUICK}[excitation.criterion]\nkind = "condition"\nweights = '
    problem = problem_of(tmp_path, f"{tables}[1.0, 4.0, 0.5]\n")
    x = drawn(problem)
    gram = gram_of(problem, x, np.array([1.0, 4.0, 0.5]))
    assert problem.criterion_value(x) == pytest.approx(np.sqrt(np.linalg.cond(gram)), rel=1e-6)
    known = earlier(tmp_path)
    problem = problem_of(tmp_path, f'{tables}"noise"\n', known)
    gram = gram_of(problem, x, known.independent_rate / known.noise**2)
    assert problem.criterion_value(x) == pytest.approx(np.sqrt(np.linalg.cond(gram)), rel=1e-6)


@pytest.mark.parametrize(
    ("chosen", "count"), [('["viscous"]', 3), ('["viscous.boom_joint", "mx.boom"]', 2)]
)
def test_chosen_parameters(tmp_path: Path, chosen: str, count: int) -> None:
    criterion = f'[excitation.criterion]\nkind = "a_optimal"\nchosen = {chosen}\n'
    problem = problem_of(tmp_path, ANY + QUICK + criterion)
    x, names = drawn(problem), problem.cases[0].shows.base.base_names
    wanted = [k for k, name in enumerate(names) if any(c in name for c in eval(chosen))]
    covariance = np.linalg.inv(gram_of(problem, x, np.ones(3)))
    assert len(wanted) == count
    assert problem.criterion_value(x) == pytest.approx(np.trace(covariance[np.ix_(wanted, wanted)]))


@pytest.mark.parametrize("kind", FIGURES)
def test_what_the_model_does_without_is_absent(tmp_path: Path, kind: str) -> None:
    """Absent columns are left out of the information; those not chosen would still be unknown."""
    criterion = f'[excitation.criterion]\nkind = "{kind}"\nwithout = ["viscous", "mx.boom"]\n'
    problem = problem_of(tmp_path, ANY + QUICK + criterion)
    whole = problem_of(tmp_path, ANY + QUICK)
    x, names = drawn(problem), whole.cases[0].shows.base.base_names
    left = [k for k, n in enumerate(names) if "viscous" not in n and n != "mx.boom"]
    assert problem.cases[0].shows.base.base_names == tuple(names[k] for k in left)
    assert len(left) == len(names) - 4
    gram = gram_of(whole, x, np.ones(3))[np.ix_(left, left)]
    assert problem.criterion_value(x) == pytest.approx(FIGURES[kind](gram), rel=1e-6)


def test_parameters_that_an_earlier_model_was_reduced_by_are_absent(tmp_path: Path) -> None:
    known = earlier(tmp_path)
    names = known.names
    small = replace(
        known,
        names=names[:-2],
        values=known.values[:-2],
        covariance=known.covariance[:-2, :-2],
        removed=names[-2:],
    )
    criterion = '[excitation.criterion]\nkind = "a_optimal"\nafter_earlier = true\n'
    problem = problem_of(tmp_path, ANY + QUICK + criterion, small)
    assert problem.cases[0].shows.base.base_names == names[:-2]
    x = drawn(problem)
    gram = gram_of(problem, x, known.independent_rate / known.noise**2)
    wanted = np.trace(np.linalg.inv(gram + np.linalg.inv(small.covariance)))
    assert problem.criterion_value(x) == pytest.approx(wanted, rel=1e-6)
    all_of_them = problem_of(tmp_path, ANY + QUICK + f"{criterion}without = []\n", small)
    assert all_of_them.cases[0].shows.base.base_names == names


def test_known_zeros_of_a_full_earlier_model_are_given(tmp_path: Path) -> None:
    """A parameter that is zero conditions the others; one that is unknown would be integrated."""
    known = earlier(tmp_path)
    problem = problem_of(tmp_path, ANY + QUICK)
    base = problem.cases[0].shows.base.without(known.names[-1:])
    given = np.linalg.inv(known.covariance)[:-1, :-1]
    np.testing.assert_allclose(known.information(base, known.names[-1:]), given, rtol=1e-9)
    unknown = np.linalg.inv(known.covariance[:-1, :-1])
    np.testing.assert_allclose(known.information(base), unknown, rtol=1e-9)


@pytest.mark.parametrize(
    ("without", "words"),
    [('["nothing"]', "neither a law nor"), ('["rigid_body", "viscous"]', "do without all")],
)
def test_what_cannot_be_absent(tmp_path: Path, without: str, words: str) -> None:
    with pytest.raises(DataError, match=words):
        problem_of(tmp_path, f"{ANY}[excitation.criterion]\nwithout = {without}\n")


@pytest.mark.slow
def test_a_motion_to_start_from_is_not_made_worse(tmp_path: Path) -> None:
    criterion = '[excitation.criterion]\nkind = "condition"\n'
    first = designed(tmp_path, ANY + QUICK + criterion)
    less = f'{criterion}without = ["viscous"]\n'
    second = designed(tmp_path, ANY + QUICK + less, seed=5, start=first.trajectory)
    assert second.shown.raw <= first.shown.raw
    assert second.absent == ("viscous.tower_joint", "viscous.boom_joint", "viscous.stick_joint")
    with pytest.raises(DataError, match="is no motion of kind 'fourier'"):
        longer = QUICK.replace("4.0", "5.0")
        designed(tmp_path, ANY + longer + criterion, start=first.trajectory)


def test_after_earlier(tmp_path: Path) -> None:
    known = earlier(tmp_path, blind=2)
    criterion = '[excitation.criterion]\nkind = "a_optimal"\nafter_earlier = true\n'
    problem = problem_of(tmp_path, ANY + QUICK + criterion, known)
    x = drawn(problem)
    prior = np.zeros((len(problem.cases[0].shows.base),) * 2)
    prior[:-2, :-2] = np.linalg.inv(known.covariance)
    gram = gram_of(problem, x, known.independent_rate / known.noise**2)
    assert problem.criterion_value(x) == pytest.approx(
        np.trace(np.linalg.inv(gram + prior)), rel=1e-6
    )


def test_given_weights_do_not_go_with_earlier_information(tmp_path: Path) -> None:
    criterion = "[excitation.criterion]\nweights = [1.0, 1.0, 1.0]\nafter_earlier = true\n"
    with pytest.raises(DataError, match="weighted by their noise"):
        problem_of(tmp_path, ANY + criterion, earlier(tmp_path))


def test_relative_to_values_over_loads(tmp_path: Path) -> None:
    known = earlier(tmp_path)
    criterion = '[excitation.criterion]\nkind = "a_optimal"\nrelative = true\n'
    load = "[[excitation.loads]]\nmass = 3.0\ncom = [0.1, 0.0, 0.0]\n"
    alone = problem_of(tmp_path, ANY + QUICK + criterion, known)
    both = problem_of(tmp_path, ANY + QUICK + criterion + load, known)
    assert (len(alone.cases), len(both.cases)) == (1, 2)
    x = drawn(alone)
    gram, std = gram_of(alone, x, np.ones(3)), np.sqrt(np.diag(known.covariance))
    sizes = np.maximum(np.abs(known.values), 2.0 * std)
    expected = np.trace(np.linalg.inv(gram * sizes[:, None] * sizes))
    assert alone.criterion_value(x) == pytest.approx(expected, rel=1e-6)
    # a heavier arm is known relatively better, so the worse case is the one without the load
    loaded = both.cases[1].criterion.value(gram)
    assert both.criterion_value(x) == pytest.approx(max(expected, loaded), rel=1e-6)
    assert loaded != pytest.approx(expected, rel=1e-3)


def test_an_earlier_model_of_other_terms_is_refused_where_sizes_are_wanted(tmp_path: Path) -> None:
    known = earlier(tmp_path)
    bare = replace(
        known,
        names=known.names[:1],
        values=known.values[:1],
        covariance=known.covariance[:1, :1],
        standard={},
    )
    with pytest.raises(DataError, match="has no value of"):
        problem_of(tmp_path, f"{ANY}[excitation.criterion]\nrelative = true\n", bare)


def test_torque_is_that_of_the_earlier_model(tmp_path: Path) -> None:
    q = np.array([[0.0, 0.4, 0.3]])
    still = np.zeros((1, 3))
    margins = []
    for size in (1.0, 2.0):
        known = earlier(tmp_path, size=size)
        (torque,) = problem_of(tmp_path, OPEN, known).constraints
        values = torque.margins(q, still, still).values[0]
        margins.append(values[torque.labels.index("torque of 'boom_joint' below 57 Nm")])
    assert 57.0 - margins[1] == pytest.approx(2.0 * (57.0 - margins[0]), rel=1e-9)
    assert margins[0] != margins[1]


def test_an_earlier_model_of_base_parameters_gives_the_same_torque(tmp_path: Path) -> None:
    known = earlier(tmp_path)
    grouped = replace(known, standard=dict(zip(known.names, known.values, strict=True)))
    state = np.random.default_rng(0).standard_normal((3, 5, 3))
    found = []
    for one in (known, grouped):
        (torque,) = problem_of(tmp_path, OPEN, one).constraints
        found.append(torque.margins(*state).values)
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.slow
def test_what_is_still_unknown_gets_known(tmp_path: Path) -> None:
    """Designed for what an earlier log left open, a motion shows that better."""
    known = earlier(tmp_path, blind=3)
    means = []
    for after in ("false", "true"):
        criterion = f'[excitation.criterion]\nkind = "a_optimal"\nafter_earlier = {after}\n'
        found = designed(tmp_path, ANY + QUICK + criterion, earlier=known)
        assert (found.prior is not None) == (after == "true")
        prior = known.information(base_parameters(model_with_open_friction(arm(tmp_path))))
        means.append(np.sum(found.shown.std(prior)[-3:] ** 2))
    assert means[1] < means[0]


@pytest.mark.slow
def test_noise_of_predictions(tmp_path: Path) -> None:
    known = earlier(tmp_path)
    plain = designed(tmp_path, ANY + QUICK)
    informed = designed(tmp_path, ANY + QUICK, earlier=known)
    assert "1 % of each joint's greatest effort" in plain.noise_from
    assert "earlier log" in informed.noise_from
    np.testing.assert_array_equal(informed.noise, known.noise)
    np.testing.assert_allclose(plain.noise, 0.6)
    half = designed(tmp_path, ANY + QUICK, earlier=replace(known, noise=0.5 * known.noise))
    np.testing.assert_allclose(half.shown.std(), 0.5 * informed.shown.std(), rtol=1e-9)
