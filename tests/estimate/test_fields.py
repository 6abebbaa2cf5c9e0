"""Fields found from invented data, against the values the data were made with."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from invented import dh_arm
from law_cases import CASES, LawCase, name_of
from steelyard.base.errors import ModelError
from steelyard.base.progress import Event, Stopped
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_parameters,
    base_regressor,
    chosen_regressor,
)
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.nonlinear.grid_search import unknowns_of
from steelyard.estimate.nonlinear.nonlinear_parameters import FoundFields, find_fields
from steelyard.model.laws.friction_over_speed import Coulomb, Coupled, Stribeck, Viscous
from steelyard.model.laws.friction_with_memory import Dahl, LuGre
from steelyard.model.laws.register import DEFAULT_TERMS, TERMS, description_of, term_of
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Find
from steelyard.model.terms.stateful_terms import CandidateTerms
from steelyard.model.terms.term import Term
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Coordinate, Robot

ROBOT = dh_arm()
JOINTS = ROBOT.joint_names
BARE = tuple(term for term in DEFAULT_TERMS if term.law != "coulomb")
InformationOf = Callable[[Regressor], Information]


def motion(seed: int, count: int = 3000) -> np.ndarray:
    """Positions, velocities and accelerations of four harmonics at 200 Hz, `(3, n, N)`."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 200.0
    total = np.zeros((3, ROBOT.n, count))
    for k in range(1, 5):
        w = 0.2 * np.pi * k
        a, b = 0.6 * rng.normal(size=(2, ROBOT.n, 1)) / k
        wave, turned = a * np.sin(w * t) + b * np.cos(w * t), a * np.cos(w * t) - b * np.sin(w * t)
        total += np.array([wave, w * turned, -w * w * wave])
    return total


def information_about(
    samples: np.ndarray, effort: np.ndarray, passes: list[Regressor]
) -> InformationOf:
    """What samples in memory say; every requested regressor is recorded."""

    def information_of(regressor: Regressor) -> Information:
        passes.append(regressor)
        sums = Accumulator(regressor)(
            Stretch(*samples, effort, None, regressor.model.scan()(*samples))
        )
        return Information(
            regressor.layout,
            Signature(
                regressor.model.fingerprint, regressor.layout.columns, ("Nm",) * ROBOT.n, "none"
            ),
            (Window("run", 0.0, 1.0),),
            sums.grams[None],
            sums.absolute[None],
            sums.counts[None],
        )

    return information_of


def data(
    terms: tuple[Term, ...], truth: Term, noise: float, seed: int = 0, size: float = 1.0
) -> tuple[InformationOf, list[Regressor]]:
    """Data of random parameters, those of the term under test equal to `size`."""
    regressor = base_regressor(Model(ROBOT, (*terms, truth)))
    samples, rng = motion(seed), np.random.default_rng(seed + 100)
    dense = regressor.dense(*samples)
    values = rng.normal(size=dense.shape[2])
    values[[n.startswith(truth.law) for n in regressor.layout.columns]] = size
    effort = dense @ values
    passes: list[Regressor] = []
    return information_about(
        samples, effort + noise * rng.normal(size=effort.shape), passes
    ), passes


def found(
    terms: tuple[Term, ...], truth: Term, wanted: Term, noise: float = 0.0, **more: Any
) -> FoundFields:
    information_of, _ = data(terms, truth, noise, **more)
    return find_fields(Model(ROBOT, (*terms, wanted)), information_of)


SPEEDS, LENGTHS = Find(1e-3, 1.0, shared=False), Find(1e-5, 3e-2, shared=False)
FOUND = [(case, field) for case in CASES for field in case.found]


@pytest.mark.parametrize(("case", "field"), FOUND, ids=name_of)
def test_exact_data_give_each_joint_its_value(case: LawCase, field: str) -> None:
    values, find = case.found[field], Find(*TERMS[case.law].bounds[field], shared=False)
    truth, wanted = case.on(ROBOT, **{field: values}), case.on(ROBOT)
    result = found(case.other_terms(), truth, replace(wanted, **{field: find}))
    assert [f.joint for f in result.findings] == list(JOINTS)
    assert all(f.field == field and f.identifiable for f in result.findings)
    assert [f.value for f in result.findings] == pytest.approx(values, rel=2e-3)
    assert getattr(result.model.terms[-1], field) == tuple(f.value for f in result.findings)
    assert result.notes == ()


@pytest.mark.parametrize(("case", "field"), FOUND, ids=name_of)
def test_exact_data_give_the_shared_value(case: LawCase, field: str) -> None:
    value, find = case.found[field][0], Find(*TERMS[case.law].bounds[field])
    truth, wanted = case.on(ROBOT, **{field: value}), case.on(ROBOT)
    result = found(case.other_terms(), truth, replace(wanted, **{field: find}))
    (finding,) = result.findings
    assert finding.joint is None and finding.value == pytest.approx(value, rel=2e-3)
    assert getattr(result.model.terms[-1], field) == finding.value


def test_every_field_that_can_be_found_is_found_here() -> None:
    """But that of couplings, whose pairs have no value per joint."""
    wanted = {(law, field) for law, term in TERMS.items() for field in term.bounds}
    assert {(case.law, field) for case, field in FOUND} == wanted - {("coupled", "smoothing")}


@pytest.mark.slow
def test_two_fields_of_one_term_are_found_together() -> None:
    truth = LuGre(length=1e-2, speed=0.2, breakaway=1.6)
    wanted = LuGre(length=Find(1e-3, 0.1), speed=Find(1e-3, 1.0), breakaway=1.6)
    result = found(BARE, truth, wanted, noise=0.02)
    values = {f.field: f for f in result.findings}
    for name, true in (("length", 1e-2), ("speed", 0.2)):
        assert values[name].value == pytest.approx(true, rel=2e-3)
        assert values[name].interval[0] < true < values[name].interval[1]


@pytest.mark.slow
def test_speed_and_arctan_smoothing_of_stribeck_are_found_together() -> None:
    """As in p3, with the Coulomb friction beside turning within a speed of its own to be found."""
    coulomb = Coulomb(smoothing=0.03, shape="arctan")
    find = Coulomb(smoothing=Find(1e-3, 1.0), shape="arctan")
    truth = Stribeck(speed=0.2, smoothing=0.03, shape="arctan")
    wanted = Stribeck(speed=Find(1e-3, 1.0), smoothing=Find(1e-3, 1.0), shape="arctan")
    information_of, _ = data((*BARE, coulomb), truth, 0.02)
    result = find_fields(Model(ROBOT, (*BARE, find, wanted)), information_of)
    values = {(f.term, f.field): f for f in result.findings}
    trues = {("coulomb", "smoothing"): 0.03, ("stribeck", "smoothing"): 0.03}
    for name, true in {**trues, ("stribeck", "speed"): 0.2}.items():
        assert values[name].value == pytest.approx(true, rel=2e-2)
        assert values[name].interval[0] < true < values[name].interval[1]


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    values, inside, total = (0.03, 0.06, 0.1), 0, 0
    for seed in range(20):
        result = found(
            DEFAULT_TERMS, Stribeck(speed=values), Stribeck(speed=SPEEDS), 0.2, seed=seed
        )
        for finding, true in zip(result.findings, values, strict=True):
            inside += finding.interval[0] <= true <= finding.interval[1]
            total += 1
            low, high = finding.interval
            assert low < finding.value < high
    assert inside / total >= 0.88


def test_wide_intervals_come_from_the_profile() -> None:
    """Against the costs of fits at chosen speeds, with the effort's true noise."""
    noise, wanted = 1.5, Stribeck(speed=Find(1e-3, 1.0))
    information_of, _ = data(DEFAULT_TERMS, Stribeck(speed=0.07), noise)
    (finding,) = find_fields(Model(ROBOT, (*DEFAULT_TERMS, wanted)), information_of).findings

    def squares(speed: float) -> float:
        model = Model(ROBOT, (*DEFAULT_TERMS, Stribeck(speed=speed)))
        matrix, vector, square = information_of(base_regressor(model)).normal(
            np.full(ROBOT.n, noise**-2)
        )
        return square - float(vector @ np.linalg.pinv(matrix, hermitian=True) @ vector)

    assert finding.identifiable and finding.interval[1] / finding.interval[0] > 1.5
    least = squares(finding.value)
    for end in finding.interval:
        assert squares(end) - least == pytest.approx(3.84, rel=0.15)


def test_data_without_the_effect_cannot_tell() -> None:
    result = found(DEFAULT_TERMS, Stribeck(), Stribeck(speed=SPEEDS), 0.5, size=0.0)
    assert not any(f.identifiable for f in result.findings)
    assert len(result.notes) == 3
    assert "bound the speed of term 'stribeck' at 'joint_1' on one side only" in result.notes[0]
    assert "log slower motion with reversals, or fix it: speed = " in result.notes[0]


def test_a_value_beyond_the_bounds_is_reported() -> None:
    result = found(DEFAULT_TERMS, Stribeck(speed=0.5), Stribeck(speed=Find(1e-3, 0.1)), 0.05)
    (finding,) = result.findings
    assert finding.value == 0.1 and finding.interval[1] == 0.1 and not finding.identifiable
    (note,) = result.notes
    assert note == (
        "the speed of term 'stribeck' is estimated at its bound 0.1; widen the search, "
        "or fix it: speed = 0.1"
    )


def test_one_open_end_is_reported() -> None:
    wanted = Dahl(length=Find(1e-6, 3e-2))
    result = found(BARE, Dahl(length=2e-6), wanted, 1.0)
    (finding,) = result.findings
    assert 1e-6 < finding.value and finding.interval[0] == 1e-6 and finding.interval[1] < 3e-3
    assert f"on one side only: below {finding.interval[1]:.3g}" in result.notes[0]


def test_bounds_are_respected() -> None:
    find = Find(0.04, 0.06, shared=False)
    result = found(DEFAULT_TERMS, Stribeck(speed=(0.02, 0.05, 0.2)), Stribeck(speed=find))
    assert [f.value for f in result.findings] == [0.04, pytest.approx(0.05, rel=1e-3), 0.06]


def test_further_passes_need_no_new_program() -> None:
    information_of, passes = data(DEFAULT_TERMS, Stribeck(speed=0.07), 0.05)
    find_fields(Model(ROBOT, (*DEFAULT_TERMS, Stribeck(speed=SPEEDS))), information_of)
    assert len(passes) >= 3
    assert len({id(r.code) for r in passes}) == 1
    keys = [r.model.program_key for r in passes]
    assert all(key == keys[0] for key in keys)
    assert len({r.model.fingerprint for r in passes}) == len(passes)


def test_candidates_keep_the_other_terms_base_parameters() -> None:
    information_of, passes = data(DEFAULT_TERMS, Stribeck(speed=0.07), 0.05)
    find_fields(Model(ROBOT, (*DEFAULT_TERMS, Stribeck(speed=SPEEDS))), information_of)
    base = base_parameters(Model(ROBOT))
    columns = passes[0].layout.columns
    assert columns[: len(base)] == base.base_names
    assert len(columns) == len(base) + 12 * ROBOT.n


@pytest.mark.parametrize(
    ("law", "field"),
    [(law, field) for law in TERMS.values() for field in law.bounds],
    ids=lambda x: getattr(x, "law", x),
)
def test_dictionary_columns_are_the_terms_columns(law: type[Any], field: str) -> None:
    fixed = {"pairs": (("joint_1", "joint_2"),), "kind": "coulomb"} if law is Coupled else {}
    low, high = law.bounds[field]
    candidates = [law(**{field: x}, **fixed) for x in np.geomspace(low, high, 4).tolist()]
    wide = Model(ROBOT, (Viscous(), CandidateTerms.of(ROBOT, candidates, candidates[-1])))
    samples, width = motion(3, 500), len(candidates[0].parameters(ROBOT))
    dense = chosen_regressor(wide, base_parameters(wide), range(len(wide.names))).dense(*samples)
    for c, term in enumerate(candidates):
        alone = Model(ROBOT, (term,))
        wanted = chosen_regressor(alone, base_parameters(alone), range(width)).dense(*samples)
        start = ROBOT.n + c * width
        assert np.allclose(dense[:, :, start : start + width], wanted, rtol=1e-12, atol=1e-14)
        assert wide.names[start : start + width] == tuple(f"{name}@{c}" for name in alone.names)
    scans = [model.scan() for model in (Model(ROBOT, (candidates[-1],)), wide)]
    for scan in scans:
        scan(*samples)
    assert np.array_equal(scans[0].warm, scans[1].warm)


@pytest.mark.slow
def test_too_many_columns_are_searched_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("steelyard.estimate.nonlinear.grid_search.WIDEST", 40)
    terms, wanted = (*BARE, Dahl(length=1e-3)), (*BARE, Dahl(length=LENGTHS))
    information_of, passes = data(terms, Stribeck(speed=0.07), 0.02)
    result = find_fields(Model(ROBOT, (*wanted, Stribeck(speed=Find(1e-3, 1.0)))), information_of)
    assert max(sum("@" in name for name in r.layout.columns) for r in passes) <= 40
    assert [f.value for f in result.findings] == pytest.approx([1e-3] * 3 + [0.07], rel=0.05)
    assert [f.term for f in result.findings] == ["dahl"] * 3 + ["stribeck"]


def test_two_terms_are_searched_together() -> None:
    wanted = (*BARE, Dahl(length=LENGTHS))
    information_of, passes = data((*BARE, Dahl(length=1e-3)), Stribeck(speed=0.07), 0.02)
    result = find_fields(Model(ROBOT, (*wanted, Stribeck(speed=Find(1e-3, 1.0)))), information_of)
    assert [f.value for f in result.findings] == pytest.approx([1e-3] * 3 + [0.07], rel=0.05)
    assert {sum("@" in name for name in r.layout.columns) for r in passes} == {2 * 12 * ROBOT.n}


def test_a_model_of_searched_terms_alone() -> None:
    result = found((), Stribeck(speed=0.07), Stribeck(speed=Find(1e-3, 1.0)))
    assert result.findings[0].value == pytest.approx(0.07, rel=1e-3)


def test_nothing_to_find_is_no_pass() -> None:
    information_of, passes = data(DEFAULT_TERMS, Stribeck(), 0.0)
    result = find_fields(Model(ROBOT), information_of)
    assert result.findings == () and passes == []


def test_a_search_can_be_watched_and_stopped() -> None:
    information_of, passes = data(DEFAULT_TERMS, Stribeck(speed=0.07), 0.05)
    events: list[Event] = []

    def watch(event: Event) -> bool:
        events.append(event)
        return len(events) < 3

    model = Model(ROBOT, (*DEFAULT_TERMS, Stribeck(speed=SPEEDS)))
    with pytest.raises(Stopped, match="estimating nonlinear parameters"):
        find_fields(model, information_of, progress=watch)
    assert len(passes) == 2 and [e.done for e in events] == [0, 1, 2]


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("find", Find(1e-3, 1.0)),
        ({"find": True, "per_joint": True}, Find(1e-3, 1.0, shared=False)),
        ({"find": [0.01, 0.5]}, Find(0.01, 0.5)),
        ({"find": [0.01, 1], "per_joint": True}, Find(0.01, 1.0, shared=False)),
    ],
)
def test_files_ask_for_a_search(given: Any, wanted: Find) -> None:
    term = term_of({"law": "stribeck", "speed": given}, "here")
    assert term == Stribeck(speed=wanted)
    again = json.loads(json.dumps(description_of(term)))
    assert term_of(again, "there") == term
    model = Model(ROBOT, (*DEFAULT_TERMS, term))
    assert Model.from_dict(json.loads(json.dumps(model.to_dict()))).terms[-1] == term


def test_a_robot_file_asks_for_a_search(tmp_path: Any) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(
        '[robot.dh]\nconvention = "modified"\nlinks = [{alpha = 1.0}]\n'
        '[model]\nterms = ["viscous", {law = "dahl", length = {find = [1e-5, 1e-2]}}]\n'
    )
    specs = load_robot(path).terms
    assert specs is not None
    assert term_of(specs[1].description, "here") == Dahl(length=Find(1e-5, 1e-2))


@pytest.mark.parametrize(
    ("description", "words"),
    [
        ({"law": "viscous", "joints": "find"}, "'joints' of term 'viscous' cannot be estimated"),
        (
            {"law": "stribeck", "exponent": "find"},
            "give 'exponent' a value; 'speed' and 'smoothing' can be estimated",
        ),
        ({"law": "lugre", "breakaway": "find"}, "'length' and 'speed' can be estimated"),
        ({"law": "dahl", "lenth": "find"}, "does not understand 'lenth'"),
        ({"law": "dahl", "length": {"find": [1.0, 0.1]}}, "the smaller one first"),
        ({"law": "dahl", "length": {"find": [0.0, 0.1]}}, "two numbers above zero"),
        ({"law": "dahl", "length": {"find": 0.1}}, 'write length = "find"'),
        ({"law": "dahl", "length": {"find": [1, 2], "each": True}}, 'write length = "find"'),
        ({"law": "dahl", "length": ["find", 0.1]}, "give each its own term"),
    ],
)
def test_wrong_requests_are_explained(description: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        term_of(description, "robot.toml, [model] terms")


def test_a_field_that_cannot_be_found_is_refused_in_a_model() -> None:
    term = Coulomb(threshold=Find(1e-3, 1.0))
    with pytest.raises(ModelError, match="'threshold' of term 'coulomb' cannot be estimated"):
        unknowns_of(Model(ROBOT, (term,)))


@pytest.mark.parametrize(
    "term",
    [Stribeck(speed=SPEEDS), Coulomb(smoothing=SPEEDS), Dahl(length=LENGTHS)],
    ids=lambda t: t.law,
)
def test_a_field_still_to_be_found_gives_no_torque(term: Term) -> None:
    model = Model(ROBOT, (term,))
    with pytest.raises(ModelError, match="is not estimated yet"):
        base_regressor(model).dense(*motion(0, 20))


def test_axes_are_named_as_the_parameters() -> None:
    arms = (Coordinate("hip", "revolute"), Coordinate("knee.left", "revolute"))
    model = Model(Robot("two", (), arms), (Viscous(), Stribeck(speed=SPEEDS)))
    assert [u.axis for u in unknowns_of(model)] == ["hip", "knee.left"]
