"""Advice where gains and masses cannot be identified together."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from check.conftest import Arm
from steelyard.check.decision.drive_gains_and_what_init_learns import unwritten_number_advice
from steelyard.check.finding import Edit


@pytest.mark.parametrize(("factor", "offered"), [(7e-4, True), (0.01, False), (1.0, False)])
def test_torques_in_thousandths_are_offered_their_gain(
    arm: Arm, factor: float, offered: bool
) -> None:
    reading = SimpleNamespace(effort_scale=np.full(3, factor), held=0.0)
    hypothesis = cast(Any, SimpleNamespace(cause="effort kind", reading=reading))
    says = unwritten_number_advice(arm.case(arm.table), hypothesis, sure=True).says
    assert says.startswith("if efforts are in mNm, write gain = 0.001") == offered
    assert "gains and masses cannot be identified together" in says


def test_the_torque_of_one_motor_is_offered_its_gear_ratio(arm: Arm) -> None:
    reading = SimpleNamespace(effort_scale=np.array([1.0, 8.0, 1.0]), held=0.0)
    hypothesis = cast(Any, SimpleNamespace(cause="gain", reading=reading))
    says = unwritten_number_advice(arm.case(arm.table), hypothesis, sure=True).says
    assert says.startswith(f"if the torque of {arm.robot.joint_names[1]} is that of the motor")


@pytest.mark.parametrize(
    ("factor", "unit", "names", "proposed"),
    [
        (620.0, "mA", "current{}_A", "A"),
        (1.4e-3, "A", "current{}_mA", "mA"),
        (20.0, "mA", "current{}_A", None),
        (620.0, "A", "current{}_A", None),
        (620.0, "mA", "current{}", None),
    ],
)
def test_the_unit_in_the_names_of_currents_is_proposed_where_it_is_the_factor(
    arm: Arm, factor: float, unit: str, names: str, proposed: str | None
) -> None:
    text = arm.text.replace("tau{}_Nm", names).replace('"joint_torque"', '"motor_current"')
    text = text.replace('unit = "Nm"', f'unit = "{unit}"\ngain = [1.0, 1.0, 1.0]')
    columns = [column.replace("tau", "current") for column in arm.columns]
    columns = [column.replace("_Nm", names.removeprefix("current{}")) for column in columns]
    case = replace(arm, columns=tuple(columns)).case(arm.table, text)
    assert case.loaded.signals is not None
    scaled = factor * case.loaded.signals.effort_scale
    reading = SimpleNamespace(effort_scale=scaled, held=0.0)
    hypothesis = cast(Any, SimpleNamespace(cause="gain", reading=reading))
    found = unwritten_number_advice(case, hypothesis, sure=True)
    wanted = (Edit(("signals", "effort", "unit"), proposed),) if proposed else ()
    assert found.edits == wanted
    assert found.says.startswith("the names of the effort columns state") == bool(proposed)
