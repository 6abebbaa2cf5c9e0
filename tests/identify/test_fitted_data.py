"""Which data are fitted: cases of people who do this job, and a simulated arm."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from check.fitted import demo_arm, log
from steelyard.identify.identify import Identification, identify
from steelyard.identify.validate import validate
from steelyard.simulate.ground_truth import random_truth
from steelyard.uses.payload.payload import identify_payload

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_stretches")]


@pytest.fixture
def case() -> Callable[[str], Path]:
    data = os.environ.get("STEELYARD_DATA")
    cases = Path(data or "").parent / "cases"

    def folder(name: str) -> Path:
        if data is None or not (cases / name).is_dir():
            pytest.skip(f"there is no folder cases/{name} beside the folder of STEELYARD_DATA")
        return cases / name

    return folder


def percent(found: Identification) -> float:
    (unseen,) = found.to_dict()["validation"]
    return float(unseen["headline"]["pooled"][0]["percent_of_used"])


def test_a_chirp_is_fitted_below_what_the_model_describes(case: Callable[[str], Path]) -> None:
    folder = case("z1-default")
    one = folder / "log.npz"
    found = identify(folder / "arm.urdf", f"{one}@0:17", f"{one}@17:23.5", check=False)
    assert percent(found) < 12.0
    assert found.model.cutoffs.matched <= 10.0
    assert any("chosen by the error on motion left out" in note for note in found.content.notes)


def test_a_contact_is_left_out_of_the_fit(case: Callable[[str], Path]) -> None:
    folder = case("contact-in-fit")
    found = identify(folder / "arm.urdf", folder / "run1.csv", folder / "run2.csv")
    assert percent(found) < 1.2
    (note,) = (n for n in found.content.notes if "a force acts" in n)
    start, stop = (float(x) for x in note.split("from ")[1].split(" s")[0].split(" to "))
    assert 9.0 <= start <= 10.3 and 12.4 <= stop <= 14.0
    assert not any("payload" in one.says for one in found.content.limitations)


def test_a_tool_that_was_removed_is_weighed(case: Callable[[str], Path]) -> None:
    folder = case("tool-removed")
    logs = [folder / "tool1.csv", folder / "tool2.csv"]
    model = identify(folder / "arm.urdf", logs, check=False).model
    found = identify_payload(model, folder / "bare.csv", "tool0")
    assert found.removed and abs(found.mass + 1.2) < max(0.02, float(found.half_width[0]))
    (reason,) = (
        one
        for one in validate(model, folder / "bare.csv").content.limitations
        if "most likely reason" in one.says
    )
    assert "carries about 1.2 kg less on 'wrist3_link'" in reason.says


def test_false_stretches_of_another_arm_cost_no_accuracy(tmp_path: Path) -> None:
    arm = demo_arm(tmp_path, joints=3)
    truth = random_truth(arm.robot, 5)
    for name, seed in (("fit", 1), ("other", 2)):
        log(tmp_path / f"{name}.parquet", truth, seed)
    clean = identify(arm, tmp_path / "fit.parquet", tmp_path / "other.parquet", check=False)
    table = pl.read_parquet(tmp_path / "fit.parquet")
    columns = {name: table[name].to_numpy().copy() for name in table.columns}
    columns["tau2_Nm"][300:500] = 0.0
    columns["q1_rad"][750:900] = columns["q1_rad"][750]
    columns["tau1_Nm"][1500:1750] += 8.0 * np.sin(np.linspace(0.0, np.pi, 250))
    pl.DataFrame(columns).write_parquet(tmp_path / "bad.parquet")
    found = identify(arm, tmp_path / "bad.parquet", tmp_path / "other.parquet")
    notes = " ".join(found.content.notes)
    assert "efforts of tau2_Nm from 2.4 to 3.992 s left out" in notes
    assert "6 to 7.192 s left out: an encoder is frozen" in notes
    assert "a force acts" in notes
    assert percent(found) < 1.5 * percent(clean)
