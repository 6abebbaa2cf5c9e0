"""The Python interface: every name has an example, and every example does what it says."""

import doctest
import operator
import re
import types
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import steelyard
from steelyard import terms
from steelyard.model.equations.inverse_dynamics import inverse_dynamics

pytestmark = pytest.mark.usefixtures("searches_here")


@pytest.fixture(scope="module")
def folder(small_arm: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the arm, two logs of it, and its identified model."""
    place = tmp_path_factory.mktemp("interface")
    copytree(small_arm, place, dirs_exist_ok=True)
    return place


QUANTITIES = sorted(
    name
    for name in vars(steelyard.Dynamics)
    if name[0] != "_" and name not in steelyard.Dynamics.__abstractmethods__
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [n for n in steelyard.__all__ if n != "terms"] + [f"Dynamics.{n}" for n in QUANTITIES],
)
def test_every_name_has_an_example_that_holds(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    names = {each: getattr(steelyard, each) for each in steelyard.__all__}
    documented = operator.attrgetter(name)(steelyard)
    found = doctest.DocTestParser().get_doctest(
        documented.__doc__ or "", dict(names), name, None, 0
    )
    assert found.examples, f"{name} has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.REPORT_NDIFF)
    output: list[str] = []
    runner.run(found, out=output.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(output)


def test_all_names_are_listed() -> None:
    assert set(steelyard.__all__) < set(dir(steelyard))
    assert not [name for name in dir(steelyard) if name[0] == "_" and name != "__version__"]
    assert all(
        not isinstance(getattr(steelyard, n), types.ModuleType) or n == "terms"
        for n in steelyard.__all__
    )
    assert {"Coulomb", "RigidBody", "Stribeck"} < set(dir(terms))
    assert terms.Viscous.law == "viscous"
    with pytest.raises(AttributeError, match="no attribute 'Sticky'"):
        terms.Sticky  # noqa: B018


def test_the_page_lists_all_names() -> None:
    page = (Path(__file__).parent.parent / "docs" / "python.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(steelyard.__all__)


def test_large_values_print_in_a_few_lines(folder: Path) -> None:
    model = steelyard.load_model(folder / "arm-model")
    assert len(str(model).splitlines()) == 5
    for value in (model, model.model, model.valued, model.base, model.estimate):
        assert len(repr(value)) < 200, type(value)
    assert len(repr(steelyard.load_robot(folder / "arm.toml"))) < 300
    (run,) = steelyard.load_runs(folder / "arm.toml", folder / "fit.csv")
    assert len(repr(steelyard.information(model.model, [run]))) < 200


def test_quantities_add_up_to_the_torque(folder: Path) -> None:
    model = steelyard.load_model(folder / "arm-model")
    rng = np.random.default_rng(3)
    q, dq, ddq = (rng.uniform(-2.0, 2.0, (20, 2)) for _ in range(3))
    motion = steelyard.Motion(np.zeros(20), q, dq, ddq)
    masses = model.mass_matrix(q)
    np.testing.assert_allclose(masses, masses.swapaxes(1, 2))
    assert (np.linalg.eigvalsh(masses) > 0.0).all()
    offset = model.torque(steelyard.Motion([0.0], [[0.3, 0.4]], [[0.0, 0.0]], [[0.0, 0.0]]))
    offset = offset[0] - model.gravity([0.3, 0.4])
    parts = np.einsum("nij,nj->ni", masses, ddq) + model.bias(q, dq) + model.friction(motion)
    np.testing.assert_allclose(parts + offset, model.torque(motion), atol=1e-9)
    tens = [model.valued.values.values[10 * k : 10 * k + 10].tolist() for k in range(2)]
    from steelyard.model.equations.inverse_dynamics import JointState

    state = JointState(q[0].tolist(), dq[0].tolist(), [0.0, 0.0], [])
    expected = inverse_dynamics(model.model.robot, state, tens)
    np.testing.assert_allclose(model.bias(q[0], dq[0]), np.array(expected, dtype=float), atol=1e-9)


@pytest.mark.slow
def test_results_print_save_and_tabulate(folder: Path, tmp_path: Path) -> None:
    found = steelyard.identify(
        folder / "arm.toml", folder / "fit.csv", validate=folder / "other.csv"
    )
    assert "joint1" in str(found) and found.verdict.headline[:60] in str(found)
    assert found.scores["joint"].to_list() == ["joint1", "joint2"] * 2
    with pytest.raises(steelyard.SteelyardError, match="no column 'eror'") as caught:
        found.scores["eror"]
    assert caught.value.fix.startswith("did you mean 'error'")
    for column in ("run", "joint", "error", "unit", "moving", "band_hz"):
        assert f" {column} " in str(found.scores.table)
    assert set(found.parameters["name"]) >= set(found.model.estimate.parameters.names)
    level = found.verdict.level.upper()
    assert repr(found).startswith(f"Identification({found.content.robot}: {level}, ")
    assert repr(found).endswith(" % of the effort used)") and "\n" not in repr(found)
    untested = replace(found, content=replace(found.content, scores=()))
    assert repr(untested) == f"Identification({found.content.robot}: no verdict)"
    assert "<strong>" in found._repr_html_() and "joint2" in found._repr_html_()
    assert found.report().startswith("<!doctype html>")
    saved = found.save(tmp_path / "out")
    assert {path.name for path in saved.iterdir()} == {
        "model.json",
        "parameters.csv",
        "report.html",
    }
    with pytest.raises(steelyard.SteelyardError, match="exists already"):
        found.save(saved)
    again = steelyard.validate(saved, folder / "other.csv")
    errors = found.content.scores[0].errors
    assert again.scores["error"].to_list() == pytest.approx([j.error for j in errors.joints])
    assert again.scores["unit"].to_list() == ["Nm", "Nm"]
    assert again.scores["band_hz"].to_list() == [errors.cutoff] * 2


@pytest.mark.slow
def test_scores_print_as_a_table_per_log(folder: Path) -> None:
    scores = steelyard.validate(folder / "arm-model", folder / "other.csv").scores
    assert repr(scores) == str(scores)
    title, headings, _, *joints, pooled = str(scores).splitlines()
    assert title == "other, not fitted (RMS below 5 Hz, where each joint moves)"
    assert headings.split() == "joint error of used of limit used limit over".split()
    assert [line.split()[0] for line in joints] == ["joint1", "joint2"]
    assert pooled.startswith("pooled")
    assert scores.table["rmse"].to_list() == scores["rmse"].to_list()
    assert scores._repr_html_() == f"<pre>{scores}</pre>"
    found = steelyard.identify(
        folder / "arm.toml", folder / "fit.csv", validate=folder / "other.csv"
    ).scores
    assert [line for line in str(found).splitlines() if "fitted" in line] == [
        "fit, fitted (RMS below 5 Hz, where each joint moves)",
        title,
    ]


def test_residuals_are_in_the_band_of_the_printed_errors(folder: Path) -> None:
    model = steelyard.load_model(folder / "arm-model")
    printed = steelyard.validate(model, folder / "other.csv").scores
    found = steelyard.residuals(model, folder / "other.csv")
    assert found.cutoff == printed["band_hz"][0] and found.units == ("Nm", "Nm")
    counted = np.where(found.moving, found.residual, np.nan)
    np.testing.assert_allclose(np.sqrt(np.nanmean(counted**2, axis=0)), printed["error"], rtol=1e-6)
    np.testing.assert_allclose(found.error, printed["error"], rtol=1e-9)
    assert found.table.columns[:5] == ["t", "joint", "measured", "predicted", "residual"]
    second = found.table.filter(found.table["joint"] == "joint2")
    np.testing.assert_array_equal(second["residual"], found.residual[:, 1])
    np.testing.assert_array_equal(second["t"], found.t)
    assert repr(found).startswith(f"Residuals(other, below 5 Hz: joint1 {found.error[0]:.3g} Nm, ")
    wide = steelyard.residuals(model, folder / "other.csv", cutoff=20.0)
    assert wide.cutoff == 20.0 and (wide.error > found.error).all()
    with pytest.raises(steelyard.SteelyardError, match="a low-pass of 0 Hz passes nothing"):
        steelyard.residuals(model, folder / "other.csv", cutoff=0.0)
    with pytest.raises(steelyard.SteelyardError, match="cut-off"):
        steelyard.residuals(model, folder / "other.csv", cutoff=1e4)


def test_residuals_have_the_unit_of_the_printed_errors(folder: Path, tmp_path: Path) -> None:
    current = signals_of_currents(folder / "arm-model")
    for gains, unit in (([2.0, -4.0], "Nm"), ([1.0, -4.0], "A")):
        model = replace(current, signals=replace(current.signals, gains=np.array(gains)))
        found = steelyard.residuals(model, folder / "other.csv")
        printed = steelyard.validate(model, folder / "other.csv").scores
        assert found.units == (unit, unit) and printed["unit"].to_list() == [unit, unit]
        np.testing.assert_allclose(found.error, printed["error"], rtol=1e-9)


def signals_of_currents(model: Path) -> steelyard.IdentifiedModel:
    """The model with its efforts logged as currents."""
    identified = steelyard.load_model(model)
    amperes = replace(identified.signals, effort_units=("A", "A"), effort_kind="motor_current")
    return replace(identified, signals=amperes)


def test_a_file_of_another_name_is_not_written_over(folder: Path, tmp_path: Path) -> None:
    model = steelyard.load_model(folder / "arm-model")
    target = tmp_path / "arm.urdf"
    steelyard.export(model, target)
    with pytest.raises(steelyard.SteelyardError, match="exists already"):
        steelyard.export(model, target)
    with pytest.raises(steelyard.SteelyardError, match="no format"):
        steelyard.export(model, tmp_path / "arm.sdf")
