"""Parts of a model's efforts, for every law."""

import numpy as np
import pytest

from law_cases import CASES, LawCase, name_of
from moving import geared
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model

ROBOT = geared()


@pytest.mark.parametrize("case", [c for c in CASES if c.law != "rigid_body"], ids=name_of)
def test_efforts_of_friction_are_those_of_all_its_laws(case: LawCase) -> None:
    law = case.on(ROBOT)
    own = (law,) if case.energy != "kept" else ()
    beside = () if case.law == "viscous" else (Viscous(),)
    valued, expected = (
        model.at(Parameters(model.names, model.units, np.ones(len(model.names))))
        for model in (
            Model(ROBOT, (RigidBody(), *beside, law)),
            Model(ROBOT, (*beside, *own)),
        )
    )
    t = np.linspace(0.0, 1.0, 50)[:, None]
    rates = np.array([2.0, 3.0, 4.0, 5.0])
    wave = np.sin(rates * t), rates * np.cos(rates * t), -rates * rates * np.sin(rates * t)
    motion = Motion(t[:, 0], *wave)
    np.testing.assert_allclose(valued.friction(motion), expected.torque(motion))
