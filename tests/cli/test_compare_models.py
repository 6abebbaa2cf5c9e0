"""`steelyard compare-models`: several identified models on the same logs."""

import json
from pathlib import Path

import numpy as np
import pytest

import steelyard
from cli.conftest import Command
from steelyard.base.files import write_json
from steelyard.estimate.identified_model import IdentifiedModel

LOG = "../given/validation.csv"


@pytest.fixture(scope="module")
def models(identified: Path, given: Path) -> dict[str, IdentifiedModel]:
    """A model, the same reduced, and the same with gains twice as large."""
    full = steelyard.load_model(identified)
    small = steelyard.reduce(full, given / "identification.csv").model
    data = json.loads((identified / "model.json").read_text())
    data["signals"]["gains"] = [2.0] * full.robot.n
    return {"full": full, "small": small, "doubled": IdentifiedModel.from_dict(data)}


@pytest.mark.slow
def test_errors_of_the_first_model_are_those_of_validate(
    command: Command, identified: Path, models: dict[str, IdentifiedModel], tmp_path: Path
) -> None:
    small = tmp_path / "small"
    small.mkdir()
    (small / "model.json").write_text(models["small"].text())
    out = tmp_path / "out"
    done = command("compare-models", identified, small, "--on", LOG, "-o", out)
    assert done.exit_code == 0, done.stderr
    text = " ".join(done.stdout.split())
    assert "RMS error of all joints: out " in text and ", small " in text
    assert "small: reduced" in text and "link inertias not estimated" in text
    assert str(out / "models.html") in "".join(done.stdout.split())
    assert "Masses and centres" in (out / "models.html").read_text()
    told = json.loads((out / "models.json").read_text())
    for name, folder in (("out", identified), ("small", small)):
        validated = json.loads(command("validate", folder, LOG, "--json").stdout)[0]
        mine = [one for one in told["errors"] if one["model"] == name]
        for one, other in zip(mine, validated["headline"]["joints"], strict=True):
            assert one["rmse"] == pytest.approx(other["error"], rel=1e-6)
            assert one["percent_of_used"] == pytest.approx(other["percent_of_used"], rel=1e-6)
            assert one["mae"] < one["rmse"] and not one["fitted"]
        (pooled,) = [one for one in told["all_joints"] if one["model"] == name]
        assert pooled["rmse"] == pytest.approx(validated["headline"]["pooled"][0]["error"])
    removed = {one["parameter"] for one in told["parameters"] if one["status"] == "removed"}
    assert removed == {one.name for one in models["small"].estimate.removed}
    json.loads(command("compare-models", identified, small, "--on", LOG, "--json").stdout)


def test_all_models_predict_the_same_effort(
    given: Path, models: dict[str, IdentifiedModel]
) -> None:
    logs = [given / "validation.csv", given / "identification.csv"]
    found = steelyard.compare_models(models, logs)
    full, _, doubled = found.comparison.models
    for one, other in zip(full.runs, doubled.runs, strict=True):
        np.testing.assert_array_equal(one.measured, other.measured)
        np.testing.assert_allclose(other.predicted, 0.5 * one.predicted, atol=1e-9)
    rows = found.errors.filter(found.errors["run"] == "identification")
    assert rows["fitted"].all() and len(found.errors) == 3 * 2 * full.identified.robot.n
    assert "identification was used to identify full, small, doubled: no validation" in str(found)
    assert found.comparison.pooled_runs == (0,)
    efforts = found.efforts
    first = efforts.filter((efforts["model"] == "full") & (efforts["run"] == "validation"))
    assert len(first) == full.runs[0].predicted.size
    assert set(first["joint"]) == set(full.identified.joints)
    assert set(found.bodies["model"]) == {"full", "doubled"}
    assert set(found.parameters["model"]) == set(models)
    assert (
        "1 log that no model was identified from" in str(found)
        and len(str(found).splitlines()) < 25
    )


def test_other_processing_is_noted(given: Path, models: dict[str, IdentifiedModel]) -> None:
    data = models["full"].to_dict()
    data["processing"]["effort"] = {"method": "moving_average", "span": 9, "passes": 2}
    smooth = IdentifiedModel.from_dict(data)
    found = steelyard.compare_models([smooth, models["full"]], given / "validation.csv")
    (note,) = found.content.notes
    assert note == (
        "logs are processed as for model 1; model 2: identified with other [processing]"
    )
    again = steelyard.compare_models([models["full"], models["full"]], given / "validation.csv")
    assert not again.content.notes
    one, other = (x.comparison.models[0].runs[0].measured for x in (found, again))
    assert np.abs(one - other).max() > 1e-3 * np.abs(other).max()


def test_what_cannot_be_compared_is_refused(
    command: Command, identified: Path, models: dict[str, IdentifiedModel], tmp_path: Path
) -> None:
    done = command("compare-models", identified, "--on", LOG)
    assert done.exit_code == 2 and "1 model is given" in done.stderr
    assert "steelyard validate" in done.stderr
    done = command("compare-models", identified, identified)
    assert done.exit_code == 2 and "--on" in done.stderr
    data = models["full"].to_dict()
    data["model"]["robot"]["coordinates"][0]["name"] = "hip"
    (tmp_path / "other").mkdir()
    write_json(tmp_path / "other" / "model.json", data)
    done = command("compare-models", identified, tmp_path / "other", "--on", LOG)
    assert done.exit_code == 2 and "compare models of the same robot" in done.stderr
    with pytest.raises(steelyard.SteelyardError, match="no model is given"):
        steelyard.compare_models([], LOG)
    with pytest.raises(steelyard.SteelyardError, match="no log is given"):
        steelyard.compare_models(list(models.values()), [])
