"""Logs of one joint that swings, made from a model, for tests of scores."""

from pathlib import Path

import numpy as np

from invented import single
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run

MODEL = Model(single())
GAIN = 2.5
RATE = 200.0


def valued(factor: float = 1.0) -> ValuedModel:
    values = np.random.default_rng(0).normal(size=len(MODEL.names)) * factor
    return MODEL.at(Parameters(MODEL.names, MODEL.units, values))


def run_of(
    effort_of: object, rest: float = 0.0, pause: bool = False, rest_speed: float | None = None
) -> Run:
    """A log of one joint: rest, then a swing, with a pause from 5 to 8 s; effort in amperes."""
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    phase = np.clip(t - rest, 0.0, None)
    if pause:
        ramp = np.clip(np.minimum(abs(t - 6.5) - 1.5, 0.5), 0.0, 0.5) / 0.5
        phase = np.cumsum(ramp**2 * (3.0 - 2.0 * ramp)) / RATE
    fade = np.clip(phase, 0.0, 1.0) ** 3
    q = 0.8 * fade * np.sin(2.0 * phase)
    dq, ddq = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    effort = effort_of(Motion(t, q[:, None], dq[:, None], ddq[:, None]))  # type: ignore[operator]
    one = np.ones(1)
    signals = Signals(
        "t", 1.0, ("q",), one, None, None, ("i",), one, "motor_current", ("A",), GAIN * one
    )
    table = np.column_stack([t, q, effort])
    log = LogInMemory(Path("swing"), ("t", "q", "i"), table)
    return prepare(Recording(log, signals), Processing(20.0, 5.0, rest_speed))
