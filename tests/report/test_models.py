"""The page with several identified models: tables, pictures, JSON, terminal."""

import json
from dataclasses import replace

import numpy as np
import pytest

from report.conftest import EVIL, estimate, identified, robot, run_score
from steelyard.estimate.estimate import Removed
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.model_comparison import ComparedModel, ModelComparison, ModelErrors
from steelyard.identify.comparison.models_page import (
    COMPARE_MODELS_SECTIONS,
    ModelMassesSection,
    ModelParametersSection,
    ModelsContent,
    ModelsSection,
    error_tables,
    models_headline,
)
from steelyard.report.page import render_sections

JOINTS = ("shoulder", "elbow")


def reduced(model: IdentifiedModel) -> IdentifiedModel:
    """Without its third base parameter, and without values of single links."""
    name = model.base.base_names[2]
    base = model.base.without([name])
    removed = (Removed(name, 1, 0.4),)
    return replace(model, base=base, estimate=replace(estimate(base), removed=removed))


def errors(run: str, error: float, fitted: bool, seed: int) -> ModelErrors:
    score = run_score(run, JOINTS, error=error, seed=seed)
    traces = score.traces
    efforts = 10.0 * traces.measured, 10.0 * traces.predicted
    return ModelErrors(run, fitted, score.errors, np.array([0.7, 0.5]), traces.t, *efforts)


def models_content(
    *names: str, runs: tuple[str, ...] = ("points", "circle"), used: tuple[int, ...] = (1,)
) -> ModelsContent:
    """Models with errors of 10 %, 20 %, ..., the last one reduced; the second knows `used` logs."""
    full = identified(robot())
    given = names or ("full", "reduced")
    models = [
        ComparedModel(
            name,
            reduced(full) if k == len(given) - 1 else full,
            tuple(
                errors(run, 0.1 * (k + 1) * (1 + r), k == 1 and r in used, r)
                for r, run in enumerate(runs)
            ),
        )
        for k, name in enumerate(given)
    ]
    return ModelsContent(
        "Models", full.robot.name, models=ModelComparison(tuple(models)), notes=("a note",)
    )


def render_models(content: ModelsContent) -> str:
    return render_sections(COMPARE_MODELS_SECTIONS, content, "compared")


def test_tables_have_errors_and_their_share_of_the_effort() -> None:
    found = models_content().models
    assert found is not None
    every, points, circle = error_tables(found)
    assert every.headings == ("Joint", "Effort used", "full", "reduced", "Unit")
    assert points.rows[0].cells[:2] == ("shoulder", "20.0")
    assert points.rows[0].cells[2:] == ("2.00 (10\u00a0%)", "4.00 (20\u00a0%)", "Nm")
    assert circle.rows[1].cells[3] == "12.0 (40\u00a0%)*" and "no validation" in every.words
    (single,) = error_tables(models_content(runs=("points",)).models)  # type: ignore[arg-type]
    assert single.caption == "points" and "*" not in single.words


@pytest.mark.parametrize(
    ("used", "caption", "factor", "mark"),
    [
        ((), "All 2 logs", np.sqrt(2.5), ""),
        ((1,), "1 log that no model was identified from", 1.0, ""),
        ((0, 1), "All 2 logs", np.sqrt(2.5), "*"),
    ],
)
def test_errors_are_pooled_over_logs_that_no_model_knows(
    used: tuple[int, ...], caption: str, factor: float, mark: str
) -> None:
    """The second log has errors twice as large."""
    found = models_content(used=used).models
    assert found is not None
    every = error_tables(found)[0]
    pooled = factor * np.sqrt((2.0**2 + 3.0**2) / 2.0)
    assert every.caption == caption
    assert every.rows[0].cells[2].startswith(f"{2.0 * factor:.2f} (")
    assert every.rows[-1].total and every.rows[-1].cells[2].startswith(f"{pooled:.2f} (")
    assert every.rows[-1].cells[3].endswith(f"){mark}")
    assert ("no validation" in every.note) == bool(mark)
    assert ("no validation" in every.words) == bool(used)
    assert f"full {pooled:.2f} Nm (1" in models_headline(found)


def test_a_joint_at_rest_has_no_share() -> None:
    content = models_content(runs=("points",))
    assert content.models is not None
    model = content.models.models[0]
    (run,) = model.runs
    joints = (replace(run.errors.joints[0], counted=False), run.errors.joints[1])
    run = replace(run, errors=replace(run.errors, joints=joints))
    found = ModelComparison((replace(model, runs=(run,)), content.models.models[1]))
    assert error_tables(found)[0].rows[0].cells[2] == "2.00 (at rest)"
    twice = ModelComparison(tuple(replace(x, runs=x.runs * 2) for x in found.models))
    assert twice.pooled_runs == (0, 1)
    assert error_tables(twice)[0].rows[0].cells[1:3] == ("–", "–")


def test_parameters_stand_in_one_set() -> None:
    content = models_content()
    (table,) = ModelParametersSection().tables(content)
    found = content.models
    assert found is not None
    full = found.models[0].identified
    assert [row.cells[0] for row in table.rows] == list(full.base.base_names)
    assert table.rows[2].cells[2] == "0, removed"
    blind = full.base.base_names[-1]
    assert table.rows[-1].cells[0] == blind and table.rows[-1].cells[2] == "not identifiable"
    (models,) = ModelsSection().tables(content)
    assert models.rows[0].cells[3:5] == ("0", "all valid")
    assert models.rows[1].cells[3:5] == ("1", "not estimated")
    assert models.rows[0].cells[6] == "rotor_inertia + coulomb + viscous + offset"


def test_masses_are_of_models_that_know_them() -> None:
    content = models_content()
    numbers = ModelMassesSection().numbers(content)
    assert numbers is not None
    assert [key.words for key in numbers["legend"]] == ["full"]
    assert numbers["tables"][0].headings == ("Link", "full")
    assert numbers["tables"][0].rows[0].cells[1].startswith("2.000 ± 0.0")
    assert numbers["tables"][1].rows[0].cells[1].startswith("200.0 ± ")
    assert content.models is not None
    none = ModelComparison(content.models.models[1:])
    assert ModelMassesSection().numbers(replace(content, models=none)) is None


def test_numbers_as_json() -> None:
    content = models_content()
    told = {}
    for section in COMPARE_MODELS_SECTIONS:
        told |= section.to_dict(content)
    told = json.loads(json.dumps(told, allow_nan=False))
    first = told["errors"][0]
    assert (first["run"], first["model"], first["joint"]) == ("points", "full", "shoulder")
    assert first["rmse"] == pytest.approx(2.0) and first["mae"] == 0.7 and not first["fitted"]
    assert [x["fitted"] for x in told["errors"]].count(True) == 2
    assert [x["model"] for x in told["all_joints"]] == ["full", "reduced"]
    assert told["pooled_runs"] == ["points"]
    removed = [x for x in told["parameters"] if x["status"] == "removed"]
    assert len(removed) == 1 and removed[0]["value"] == 0.0 and removed[0]["std"] is None
    assert {x["model"] for x in told["bodies"]} == {"full"}
    laws = [term["law"] for term in told["models"][0]["terms"]]
    assert laws[0] == "rigid_body" and "coulomb" in laws
    assert told["models"][1]["removed"] == [removed[0]["parameter"]]


@pytest.mark.slow
def test_the_page_draws_every_model() -> None:
    page = render_models(models_content("a", "b", "c", runs=("points",)))
    for words in ("Efforts over time", "Masses and centres", "Parameters", "a note"):
        assert words in page
    assert page.count('"name":"c"') == 1 + 2
    many = models_content(*(f"m{k}" for k in range(9)), runs=tuple(f"r{k}" for k in range(60)))
    assert "Not drawn: r42" in render_models(many)


def test_strange_names_are_only_names() -> None:
    content = models_content(EVIL, f"b{EVIL}", runs=(EVIL,))
    assert "<script>document.body" not in render_models(content)
