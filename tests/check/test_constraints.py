"""Bounds and priors that the data contradict, by invented motion of an invented robot."""

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from operator import add
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest

from invented import tree
from steelyard.base.progress import silent
from steelyard.check.case_from_files_and_precheck import case_of, subject_of
from steelyard.check.decision.hypothesis_checks import POSITION_SIGN
from steelyard.check.finding import Severity
from steelyard.check.fitted.fitted_case_causes_and_constraints import (
    BindingConstraints,
    FittedCase,
    binding_constraints,
)
from steelyard.check.fitted.post_fit_checks import constraints_check
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.prior.body_priors import Row, default_knowledge
from steelyard.model.model import Model
from steelyard.runs.runs_of_named_logs import log_files

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
TRUTH = {p.name: p.prior if p.prior is not None else 0.4 for p in MODEL.parameters}
KNOWN = default_knowledge(MODEL)
DATA = os.environ.get("STEELYARD_DATA")


def run(number: int, truth: Mapping[str, float]) -> Information:
    """A random motion of the robot with 5 % noise."""
    rng = np.random.default_rng(number)
    q, dq, ddq = rng.normal(size=(3, 4, 300))
    values = REGRESSOR.base.base_values([truth[name] for name in MODEL.names])
    effort = REGRESSOR.dense(q, dq, ddq) @ values
    noise = 0.05 * np.sqrt(np.square(effort).mean(axis=1))[:, None]
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort + noise * rng.normal(size=q.shape)))
    signature = Signature(MODEL.fingerprint, REGRESSOR.layout.columns, ("Nm",) * 4, "none")
    parts = (sums.grams[None], sums.absolute[None], sums.counts[None])
    return Information(REGRESSOR.layout, signature, (Window(f"run {number}", 0.0, 1.0),), *parts)


def found_in(truth: Mapping[str, float], **known: Any) -> BindingConstraints | None:
    """What three runs of a robot say of the constraints, each run left out in turn."""
    information = reduce(add, [run(k, {**TRUTH, **truth}) for k in range(3)])
    consistent = Consistent(REGRESSOR.base, replace(KNOWN, **known), gamma=1.0)
    return binding_constraints(MODEL, consistent(information), information, consistent)


def test_constraints_that_hold_are_not_at_fault() -> None:
    assert found_in({}) is None
    assert found_in({"viscous.left_joint": 0.0, "coulomb.tip_joint": 0.0}) is None


@pytest.mark.slow
def test_friction_that_drives_is_named_with_its_joint() -> None:
    found = found_in({"viscous.left_joint": -20.0})
    assert found is not None and not found.of_unseen and found.turned is None
    assert found.bounds == found.negative == ("viscous.left_joint",)
    assert found.joints == ("left_joint",)
    assert found.values[0].startswith("viscous.left_joint -")
    assert found.error > 2.0 * found.without
    assert found.rise > 10.0 * found.rank


@pytest.mark.slow
def test_a_value_that_the_user_states_wrongly_is_named_as_stated() -> None:
    row = Row("'viscous.tip_joint' is 0", {"viscous.tip_joint": 1.0}, 0.0, 0.0)
    found = found_in({"viscous.tip_joint": 20.0}, rows=(row,))
    assert found is not None
    assert found.bounds == (row.label,) and found.joints == ("tip_joint",)
    assert found.negative == ()


@pytest.mark.slow
def test_links_that_cannot_exist_are_named_where_no_bound_is_at_fault() -> None:
    bodies = {
        name: -TRUTH[name] for name, of in zip(KNOWN.names, KNOWN.of_bodies, strict=True) if of
    }
    found = found_in(bodies)
    assert found is not None and found.error > 2.0 * found.without
    assert found.bounds == found.joints == ()


@pytest.mark.slow
def test_efforts_of_the_opposite_sign_are_named_as_such() -> None:
    found = found_in({name: -value for name, value in TRUTH.items()})
    assert found is not None and found.turned is not None
    assert found.turned < 2.0 * found.rank < 0.1 * found.rise
    (finding,) = constraints_check(cast(FittedCase, SimpleNamespace(binding=found)))
    assert finding.headline and finding.severity.word == "wrong"
    assert finding.says.startswith("all efforts, or all positions, have the opposite sign")


def says(*parameters: str) -> tuple[str, str]:
    """The sentence and the terminal's line about bounds of some parameters."""
    joints = tuple(dict.fromkeys(name.partition(".")[2] for name in parameters))
    values = tuple(f"{name} -2 ± 0.1 Nm" for name in parameters)
    found = BindingConstraints(parameters, values, parameters, joints, 26.4, 16.3, 910.0, 58, True)
    (finding,) = constraints_check(cast(FittedCase, SimpleNamespace(binding=found)))
    assert finding.headline and finding.severity.word == "doubtful" and finding.joints == joints
    assert "raise χ² by 910, where 58 is within noise" in finding.figure
    return finding.says, finding.brief or finding.says


def test_the_finding_says_which_bounds_at_which_joints_and_what_they_may_mean() -> None:
    text, line = says("viscous.j4", "viscous.j5")
    assert "bounds at j4, j5 (viscous.j4, viscous.j5)" in text and "bounds at j4, j5" in line
    assert "error on unseen motion is 26 %, without them 16 %" in line
    assert "Least squares finds viscous.j4 -2 ± 0.1 Nm" in text
    assert "Friction below zero" in line and "Rotor" not in line
    text, line = says("rotor_inertia.j6")
    assert "Rotor inertia below zero" in line and "Friction" not in line
    text, line = says()
    assert "valid inertias of the links" in text and "--method least_squares" not in text


NARUTON = """
[robot]
urdf = "{folder}/naruton6.urdf"

[model]
terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]

[signals]
time = "time_s"
position = "q{{}}_rad"
velocity = "dq{{}}_rad_s"

[signals.effort]  # counts to Nm of the set's main.m
columns = "torque{{}}_raw"
kind = "motor_current"
unit = "A"
gain = [0.034768, 0.034768, -0.034768, 0.013562, 0.013562, 0.013562]
"""


@pytest.mark.slow
def test_signs_of_several_joints_are_not_written_where_efforts_turned_fit_better(
    tmp_path: Path,
) -> None:
    """The torque of axis 3 is logged reversed, as the set's own evaluation says, not its angle."""
    folder = Path(DATA or "") / "naruton6"
    if not DATA or not folder.is_dir():
        pytest.skip("STEELYARD_DATA names no folder with naruton6")
    robot = tmp_path / "naruton6.toml"
    robot.write_text(NARUTON.format(folder=folder).replace("-0.034768", "0.034768"))
    pl.read_parquet(folder / "naruton6_traj1.parquet")[::8].write_parquet(
        tmp_path / "fewer_rows.parquet"
    )
    logs = log_files([str(tmp_path / "fewer_rows.parquet")])
    (sign,) = POSITION_SIGN(case_of(subject_of(str(robot), logs[0]), logs, None, silent)[0])
    assert sign.severity == Severity.DOUBTFUL and "effort of 'joint3'" in sign.says
    assert sign.says.startswith("either ") and ", or " in sign.says
    assert sign.fix is not None and not sign.fix.edits
