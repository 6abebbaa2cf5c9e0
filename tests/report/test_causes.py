"""Sections and terminal tables of what was found on the way: friction, fields, gains, runs."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from steelyard.estimate.friction.friction_choice import MixScore
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.identify.page.friction_choice_and_curves import FrictionSection
from steelyard.identify.page.gains_offsets_search_and_settings import (
    DrivesSection,
    PerRunSection,
)
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.report.page import Section
from steelyard.report.tables import PlainTable

NEW: tuple[Section, ...] = (FrictionSection(), DrivesSection(), PerRunSection())


def tables_of(section: Section, content: ReportContent) -> list[PlainTable]:
    numbers = section.numbers(content)
    assert numbers is not None
    found: list[PlainTable] = numbers["tables"]
    assert all(len(row.cells) == len(t.headings) for t in found for row in t.rows)
    return found


def cells(table: PlainTable) -> list[tuple[str, ...]]:
    return [tuple(row.cells) for row in table.rows]


def printed(content: ReportContent) -> str:
    console = Console(file=io.StringIO(), width=110)
    for section in NEW:
        for part in (*section.printed(content), *section.detailed(content)):
            console.print(part)
    return console.file.getvalue()  # type: ignore[attr-defined]


@pytest.mark.parametrize("section", NEW, ids=lambda section: section.name)
def test_nothing_found_shows_no_section(section: Section, usual: ReportContent) -> None:
    estimate = replace(usual.identified.estimate, per_run=())
    model = replace(usual.identified, estimate=estimate)
    assert section.numbers(ReportContent("title", "arm", identified=model)) is None
    plain = replace(usual, friction=None, findings=(), gains=None, identified=model)
    assert section.numbers(plain) is None and not printed(plain)


@pytest.mark.parametrize("section", NEW, ids=lambda section: section.name)
def test_html_has_every_cell_once_and_as_text(
    section: Section, usual: ReportContent, nasty: ReportContent
) -> None:
    html = section.show(section.numbers(usual))  # type: ignore[arg-type]
    rows = [row for table in tables_of(section, usual) for row in table.rows]
    assert html.count("<tr") == len(rows) + len(tables_of(section, usual))
    for row in rows:
        assert all(str(cell) in html.replace("<wbr>", "") for cell in row.cells)
    evil = section.show(section.numbers(nasty))  # type: ignore[arg-type]
    assert "<script>" not in evil and "&lt;script&gt;" in evil


def test_mixes_are_compared_and_the_chosen_one_is_marked(usual: ReportContent) -> None:
    mixes, _ = tables_of(FrictionSection(), usual)
    assert cells(mixes) == [
        ("coulomb + viscous", "12.35 %", "0.0 %", "± 0.0 %", ""),
        ("coulomb (smoothing 0.02) + viscous", "9.87 %", "20.1 %", "± 1.2 %", "chosen"),
    ]
    assert [row.marked for row in mixes.rows] == [False, True]
    assert "each run is predicted by a fit to all others" in mixes.words
    html = FrictionSection().show({"tables": [mixes], "title": "Friction"})
    assert len(re.findall("<tr class=", html)) == 1


def test_fields_have_intervals_and_doubts(usual: ReportContent) -> None:
    _, fields = tables_of(FrictionSection(), usual)
    assert cells(fields) == [
        ("stribeck", "speed", "all", "0.0512", "0.0431 to 0.0612", ""),
        ("stribeck", "width", "elbow", "0.00200", "0.000100 to 0.00340", "not identifiable"),
    ]


def test_friction_and_fields_may_come_alone(usual: ReportContent) -> None:
    alone = tables_of(FrictionSection(), replace(usual, findings=()))
    assert [table.caption for table in alone] == ["Friction laws compared"]
    page = FrictionSection().show({"tables": alone, "title": "Friction"})
    summary = page[page.index("<details>") : page.index("</summary>")]
    for words in ("coulomb (smoothing 0.02) + viscous", "9.87", "with coulomb + viscous 12.35"):
        assert words in summary.replace("\u00a0", " ")
    assert page.index("</summary>") < page.index("<table") < page.index("</details>")
    alone = tables_of(FrictionSection(), replace(usual, friction=None))
    assert [table.caption for table in alone] == ["Estimated nonlinear parameters"]


def test_gains_have_intervals_unless_given(usual: ReportContent) -> None:
    (table,) = tables_of(DrivesSection(), usual)
    assert cells(table) == [
        ("shoulder", "12.0", "± 0.196", "Nm/A"),
        ("elbow", "9.83", "given", "Nm/A"),
    ]
    assert "payload" not in table.words
    assert usual.gains is not None
    ten, still = np.array([2.81, *[0.0] * 9]), np.zeros((10, 10))
    carried = PayloadEstimate("tool", "link", ten, still, np.ones(2), np.ones(2))
    with_load = replace(usual, gains=replace(usual.gains, payload=carried))
    (table,) = tables_of(DrivesSection(), with_load)
    assert "The payload of 2.81 kg fixes their scale." in table.words


def test_every_run_is_a_column(usual: ReportContent) -> None:
    (table,) = tables_of(PerRunSection(), usual)
    assert tuple(table.headings) == ("Parameter", "run1@0.6:9.5", "run2")
    assert usual.identified is not None
    name = usual.identified.estimate.per_run[0].parameters.names[0]
    assert cells(table) == [(name, "0.310", "-0.520")]
    estimate = usual.identified.estimate
    runs = (estimate.per_run[0], replace(estimate.per_run[1], parameters=estimate.parameters))
    other = replace(usual.identified, estimate=replace(estimate, per_run=runs))
    (table,) = tables_of(PerRunSection(), replace(usual, identified=other))
    assert len(table.rows) == len(estimate.parameters)
    lacking = next(row for row in table.rows if row.cells[0] == estimate.parameters.names[0])
    assert lacking.cells[1] not in ("0.310", "nan")


def test_the_terminal_has_the_same_tables(usual: ReportContent) -> None:
    text = printed(usual)
    for title in (
        "Friction laws compared",
        "Estimated nonlinear parameters",
        "Drive gains",
    ):
        assert text.count(title) == 1
    lines = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    assert ["stribeck", "speed", "all", "0.0512", "0.0431 to 0.0612"] in lines
    assert ["shoulder", "12.0", "± 0.196", "Nm/A"] in lines
    assert ["elbow", "9.83", "given", "Nm/A"] in lines
    chosen = next(line for line in lines if "smoothing 0.02" in line[0] and len(line) > 1)
    assert chosen[1:] == ["9.87 %", "20.1 %", "± 1.2 %", "chosen"]
    assert usual.gains is not None
    lacking = replace(usual.gains, known=(False, False), assumed=(False, True))
    text = printed(replace(usual, gains=lacking))
    lines = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    assert [
        "elbow",
        "9.83",
        "assumed: geometric mean of the others, not identifiable",
        "Nm/A",
    ] in lines
    assert "elbow 9.83 Nm/A (assumed: geometric mean of the others)" in " ".join(text.split())


def test_laws_without_memory_are_named_beside_laws_with_memory(usual: ReportContent) -> None:
    choice, section = usual.friction, FrictionSection()
    assert choice is not None and choice.without_memory is None
    assert "without memory" not in printed(usual)
    dahl = (Dahl(length=1e-3), Viscous())
    score = MixScore("dahl (length 0.001) + viscous", dahl, 8.1, 30.0, 1.0, True)
    table = (*(replace(mix, chosen=False) for mix in choice.table), score)
    choice = replace(choice, table=table)
    content = replace(usual, friction=choice)
    words = (
        'or controllers that keep no state between samples: friction = "auto_memoryless", laws '
        "without memory such as coulomb (smoothing 0.02) + viscous (error on motion left out "
        "22 % larger in this comparison)"
    )
    assert "auto_memoryless" not in " ".join(str(part) for part in section.printed(content))
    assert f"f{words}" in " ".join(str(part) for part in section.detailed(content))
    assert words in section.tables(content)[0].words
    given = section.to_dict(content)["friction"]
    assert given["without_memory"] == "coulomb (smoothing 0.02) + viscous"
    assert replace(choice, table=(score,)).without_memory is None


def test_given_laws_with_memory_are_a_detail(usual: ReportContent) -> None:
    assert usual.identified is not None
    given, section = replace(usual, friction=None), FrictionSection()
    usual_parts = len(list(section.detailed(given)))
    model = usual.identified.model
    model = replace(model, terms=(*model.terms, Dahl(length=1e-3)))
    content = replace(given, identified=replace(usual.identified, model=model))
    *tables, line = section.detailed(content)
    assert len(tables) == usual_parts
    assert str(line).startswith(
        "friction laws with memory (dahl): for controllers that keep no state"
    )
    chosen = section.detailed(replace(content, friction=usual.friction))
    assert not any("with memory" in str(part) for part in chosen)


def test_gains_in_the_terminal_have_intervals_or_an_origin(usual: ReportContent) -> None:
    words = " ".join(printed(usual).split())
    assert "drive gains (± 95 %): shoulder 12.0 ± 0.20 Nm/A, elbow 9.83 Nm/A (given)" in words
    assert usual.gains is not None
    lacking = replace(usual.gains, known=(False, False), assumed=(False, True))
    assert "elbow 9.83 Nm/A (assumed: geometric mean of the others)" in printed(
        replace(usual, gains=lacking)
    )
    given = replace(usual, gains=replace(usual.gains, known=(True, True), assumed=(False, False)))
    words = " ".join(printed(given).split())
    assert "drive gains: shoulder 12.0 Nm/A (given), elbow 9.83 Nm/A (given)" in words
    (table,) = DrivesSection().tables(given)
    assert table.headings[2] == "Origin"


def test_names_in_the_terminal_are_no_markup(usual: ReportContent) -> None:
    assert usual.gains is not None
    assert usual.friction is not None
    mixes = tuple(replace(mix, name=f"[/i]{mix.name}") for mix in usual.friction.table)
    named = replace(
        usual,
        gains=replace(usual.gains, joints=("[red]a[/red]", "[/b]")),
        friction=replace(usual.friction, table=mixes),
        findings=tuple(replace(f, joint="[/u]", term="[blue]") for f in usual.findings),
    )
    text = printed(named)
    assert all(name in text for name in ("[red]a[/red]", "[/b]", "[/i]", "[/u]", "[blue]"))
