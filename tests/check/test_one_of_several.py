"""Order or signs that are not as declared, where several explanations fit about as well."""

from dataclasses import replace

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.base.arrays import Array
from steelyard.check.decision.ranked_readings import ranking
from steelyard.check.decision.search_with_unknown_bodies import Explanation, Search
from steelyard.check.decision.undecided_questions import undecided
from steelyard.check.decision.verdict_of_log import _contested, one_of_several
from steelyard.check.finding import MOST_NAMED, Severity
from steelyard.check.hypotheses.hypotheses_and_their_scores import LIKELY, Hypothesis
from steelyard.check.hypotheses.readings_and_likelihood import Reading


@pytest.fixture
def search(arm: Arm) -> Search:
    """Explanations of a log that is as declared: that alone."""
    case = arm.case(arm.table, known=False)
    found = ranking(case, case.logs[0])
    assert found is not None and found.search is not None
    declared = found.search.declared
    found.search.found = {declared.reading.key: declared}
    return found.search


def add(search: Search, reading: Reading, rise: float, says: str = "", cost: float = 0.0) -> None:
    """An explanation as one change, so much likelier than the declared reading but for its cost."""
    change = Hypothesis("", says, reading, cost, ())
    log = search.declared.evidence.log + rise
    evidence = replace(search.declared.evidence, log=log, misfits=np.full(3, 0.05))
    search.found[reading.key] = Explanation(reading, (change,), evidence)


def turned(search: Search, position: Array, effort: Array) -> Reading:
    declared = search.declared.reading
    return declared.changed(
        position_scale=declared.position_scale * position,
        effort_scale=declared.effort_scale * effort,
    )


def signs(*turned: int) -> Array:
    result = np.ones(3)
    result[list(turned)] = -1.0
    return result


def test_both_are_named_and_nothing_is_written(search: Search) -> None:
    add(search, turned(search, signs(0, 2), signs(0)), 200.0)
    add(search, turned(search, signs(), signs(2)), 197.0)
    add(search, turned(search, signs(1), signs()), 200.0 - 2.0 * LIKELY)
    ((one, severity),) = one_of_several(search, ())
    assert severity == Severity.DOUBTFUL and not one.fixed and one.cause == "position sign"
    names = one.reading.likelihood.names
    first = f"position of '{names[0]}', '{names[2]}' has the opposite sign and effort of"
    second = f", or effort of '{names[2]}' has the opposite sign"
    assert one.says.startswith(f"either {first} '{names[0]}'") and one.says.endswith(second)
    assert one.odds == pytest.approx(200.0)


def test_the_mirror_of_all_joints_contests_nothing(search: Search) -> None:
    every, declared = signs(0, 1, 2), search.declared
    add(search, turned(search, signs(), every), 200.0, cost=3.0)
    bad = replace(declared.evidence, misfits=np.full(3, 0.8))
    search.found[declared.reading.key] = replace(declared, evidence=bad)
    add(search, turned(search, every, signs()).changed(delay=0.05), 200.0 - 2.0 * LIKELY)
    assert not _contested(search, "effort sign")
    add(search, turned(search, every, signs(0)), 200.0 - 2.0 * LIKELY)
    assert _contested(search, "effort sign")


def test_the_declared_signs_count_against_those_of_all_joints(search: Search) -> None:
    add(search, turned(search, signs(), signs(0, 1, 2)), 12.0)
    assert search.without("effort sign") == pytest.approx(12.0)


def test_mirrors_are_named_once(search: Search) -> None:
    every = signs(0, 1, 2)
    add(search, turned(search, signs(), every), 200.0)
    add(search, turned(search, every, signs()), 199.0)
    add(search, turned(search, signs(), signs(0)), 198.0)
    ((one, _),) = one_of_several(search, ())
    assert one.says.count("all efforts have the opposite sign") == 1
    assert "cannot distinguish" not in one.says and one.says.count(", or ") == 2


def test_more_than_a_few_are_counted_only(search: Search) -> None:
    for k, joints in enumerate(((0,), (1,), (2,), (0, 1), (1, 2))):
        add(search, turned(search, signs(), signs(*joints)), 100.0 - k)
    ((one, _),) = one_of_several(search, ())
    assert one.says.count("effort of") == MOST_NAMED and one.says.endswith(", or others")


@pytest.mark.parametrize("rise", [0.5 * LIKELY, -5.0])
def test_none_is_named_that_is_hardly_likelier(search: Search, rise: float) -> None:
    add(search, turned(search, signs(0), signs()), rise)
    assert not list(one_of_several(search, ()))


def test_a_likely_reading_with_declared_signs_leaves_no_doubt(search: Search) -> None:
    add(search, turned(search, signs(0, 2), signs(0)), 200.0)
    late = search.declared.reading.changed(delay=0.1)
    add(search, late, 195.0, "efforts are late")
    assert not list(one_of_several(search, ()))


def test_what_is_found_already_is_not_said_again(search: Search) -> None:
    add(search, turned(search, signs(0), signs()), 100.0)
    ((one, severity),) = one_of_several(search, ())
    assert not list(one_of_several(search, ((one, severity),)))


def test_other_questions_about_signs_are_open(arm: Arm, search: Search) -> None:
    add(search, turned(search, signs(0, 2), signs(0)), 200.0)
    add(search, turned(search, signs(), signs(2)), 197.0)
    case = arm.case(arm.table, known=False)
    found = ranking(case, case.logs[0])
    assert found is not None
    winners = tuple(one_of_several(search, ()))
    says = undecided(replace(found, search=search, winners=winners), "effort sign")
    assert says.startswith("undecided: ") and winners[0][0].says in says
    assert not undecided(replace(found, search=search, winners=winners), "joint order")


def test_what_does_not_explain_the_log_is_not_named(search: Search) -> None:
    reading = turned(search, signs(0), signs())
    add(search, reading, 100.0)
    found = search.found[reading.key]
    bad = replace(found.evidence, misfits=np.full(3, 0.5))
    search.found[reading.key] = replace(found, evidence=bad)
    assert not list(one_of_several(search, ()))
