"""Gains from a controller's target torques and target currents."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.conftest import MODEL_BASED
from diagnosis.test_model_based import GAINS, TAU, edits, in_amperes
from steelyard.diagnosis import Case, Edit, examine
from steelyard.diagnosis.hypotheses.controller_gains import controller_gains
from steelyard.measurement.recording import LogInMemory
from steelyard.robot_file.edits import edited


def case_with_targets(arm, text: str) -> Case:
    """Currents, and targets with friction of their own; the last joint has no target."""
    rng = np.random.default_rng(0)
    table = arm.table.copy()
    torque, dq = table[:, arm.at(TAU)], arm.motion.dq
    friction = 0.2 * torque.std(axis=0) * (np.tanh(dq / 0.05) + 0.3 * dq)
    target = torque - friction
    target[:, 2] = 0.0
    current = target / GAINS + friction / GAINS
    current += 0.02 * current.std(axis=0) * rng.standard_normal(current.shape)
    table[:, arm.at(TAU)] = torque / GAINS
    case = arm.case(table, text, known=False)
    names = [f"{kind}{j}" for kind in ("tau_target_", "current_target_") for j in range(1, 4)]
    (evidence,) = case.logs
    log = LogInMemory(Path("log"), (*arm.columns, *names), np.hstack([table, target, current]))
    recording = replace(evidence.recording, log=log)
    return replace(case, logs=(replace(evidence, recording=recording),))


def test_gains_are_those_of_the_targets_within_their_intervals(arm):
    gains = controller_gains(case_with_targets(arm, in_amperes(arm)))
    assert gains.columns == ("tau_target_1", "current_target_1")
    assert gains.known.tolist() == [True] * 2 + [False]
    error = np.abs(gains.values - GAINS)[:2]
    assert np.all(error < 0.03 * GAINS[:2])
    assert gains.entries[2] == "identify"


def test_gains_of_one_are_refused_with_the_controllers(arm):
    text = edited(in_amperes(arm), [Edit(("signals", "effort", "gain"), [1.0] * 3)])
    found = examine(case_with_targets(arm, text), checks=MODEL_BASED)
    gain = edits(found)["signals.effort.gain"]
    np.testing.assert_allclose(gain[:2], GAINS[:2], rtol=0.03)
    assert gain[2] == "identify"


@pytest.mark.parametrize("kind", ["no targets", "torques"])
def test_without_targets_or_currents_there_are_none(arm, kind):
    case = case_with_targets(arm, arm.text if kind == "torques" else in_amperes(arm))
    if kind == "no targets":
        case = arm.case(arm.table, in_amperes(arm), known=False)
    assert controller_gains(case) is None
