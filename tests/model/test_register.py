"""What the register requires of a law, and what the docs say of all laws."""

import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import pytest

from law_cases import CASES, LawCase, name_of
from moving import geared
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import PolynomialSpring
from steelyard.model.laws.register import REQUIRED, TERMS, complete, law_of
from steelyard.model.terms.stateful_terms import Presliding
from steelyard.model.terms.term import ActsOnAxes, StatefulTerm, Term

DOCS = Path(__file__).parents[2] / "docs"


def rows_of_laws() -> dict[str, str]:
    """Rows of the table of laws, by law."""
    text = (DOCS / "robot-file.md").read_text(encoding="utf-8")
    table = text.partition("| law | effort |")[2].partition("\n\n")[0]
    rows = [row for row in table.splitlines() if row.startswith("| `")]
    named = [(law, row) for row in rows for law in row.split("|")[1].split(",")]
    return {law.strip(" `"): row for law, row in named}


def test_the_table_of_the_docs_names_every_law_and_its_fields() -> None:
    rows = rows_of_laws()
    assert set(rows) == set(TERMS)
    whole = {law for law, row in rows.items() if "*as a whole*" in row}
    assert whole == {law for law, term in TERMS.items() if term.dissipation == "together"}
    general = {f.name for f in fields(ActsOnAxes)}
    for law, row in rows.items():
        for field in (f for f in fields(TERMS[law]) if f.name not in general):
            assert f"`{field.name}" in row, f"the docs' row of {law} lacks {field.name}"
            if isinstance(field.default, int | float) and not isinstance(field.default, bool):
                default = re.search(rf"`{field.name} = ([^`]+)`", row)
                assert default and float(default[1]) == field.default, (law, field.name)


@pytest.mark.parametrize("name", ["law", *REQUIRED])
def test_a_law_that_lacks_something_is_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert complete(PolynomialSpring) is PolynomialSpring
    monkeypatch.delattr(PolynomialSpring, name)
    with pytest.raises(TypeError, match=f"law PolynomialSpring: lacks '{name}'"):
        complete(PolynomialSpring)


@dataclass(frozen=True)
class Unfinished(Viscous):
    reference: float = 0.0


@dataclass(frozen=True)
class Astray(Viscous):
    bounds: ClassVar[Any] = {"speed": (0.1, 1.0)}


@dataclass(frozen=True)
class Elastic(Viscous):
    cause: ClassVar[Any] = "spring"


@dataclass(frozen=True)
class Secret(Viscous):
    def remember(self) -> None: ...


@dataclass(frozen=True)
class Stepless(Presliding):
    law: ClassVar[str] = "stepless"


class Placeless(Term):
    dissipation: ClassVar[Any] = "each"


class Formless(ActsOnAxes, StatefulTerm):
    dissipation: ClassVar[Any] = "each"


class Aside(StatefulTerm):
    dissipation: ClassVar[Any] = "none"


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Unfinished, "'reference' without `needs_reference`"),
        (Astray, "'speed' of `bounds` is no field"),
        (Elastic, "lacks 'law'"),
        (Elastic, "dissipates, but is no friction"),
        (Secret, "has memory, but is no `StatefulTerm`"),
        (Stepless, "lacks 'steps'"),
        (Stepless, "lacks 'aside'"),
        (dataclass(Placeless), "does not act along coordinates"),
        (dataclass(frozen=True)(Formless), "no `Presliding`"),
        (dataclass(frozen=True)(Aside), "no `Presliding`: the virtual robot cannot step it"),
    ],
)
def test_a_law_that_contradicts_itself_is_refused(law: type[Term], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        complete(law)


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_a_parameter_names_its_law(case: LawCase) -> None:
    term = case.on(geared())
    assert all(law_of(p.name) is type(term) for p in term.parameters(geared()))


def test_another_parameter_names_no_law() -> None:
    with pytest.raises(KeyError):
        law_of("zero_offset.tip_joint")


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_all_that_is_no_friction_keeps_energy_or_is_an_offset(case: LawCase) -> None:
    assert (TERMS[case.law].cause == "friction") == (case.energy != "kept")


def test_friction_drifts_and_is_shown_by_a_motion() -> None:
    lasting = {law for law, term in TERMS.items() if not term.drifts()}
    assert lasting == {
        "rigid_body", "rotor_inertia", "spring", "gravity_compensator", "cogging",
        "polynomial_spring",
    }  # fmt: skip
    assert all(term.shown_by for term in TERMS.values())
