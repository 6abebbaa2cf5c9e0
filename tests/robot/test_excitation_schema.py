"""The `[excitation]` tables as they are read: defaults, kinds, and what flaws are called."""

from pathlib import Path

import pytest

from steelyard.base.errors import ModelError
from steelyard.robot.file.excitation_sections import (
    KINDS,
    MOTIONS,
    ExcitationSection,
    changed_excitation,
)
from steelyard.robot.file.sections import RobotFile
from steelyard.robot.file.toml_schema import checked


def read(tables: str) -> ExcitationSection:
    text = f'[robot]\nurdf = "arm.urdf"\n{tables}\n'
    return checked(Path("arm.toml"), text, RobotFile)[0].excitation


def test_nothing_given_is_a_fourier_series() -> None:
    section = read("")
    assert section == ExcitationSection()
    assert (section.motion.kind, section.criterion.kind) == ("fourier", "d_optimal")
    assert section.limits.share == 0.95 and section.collision is None


def test_a_motion_without_kind_is_a_fourier_series() -> None:
    motion = read("[excitation.motion]\nperiod = 20\n").motion
    assert motion.model_dump() == {
        "kind": "fourier",
        "period": 20.0,
        "harmonics": 5,
        "start": None,
        "end": None,
    }


def test_kinds_are_those_of_the_sections() -> None:
    assert len(KINDS) == len(MOTIONS) == len(set(KINDS))
    assert "ramped_fourier" in KINDS


@pytest.mark.parametrize(
    ("tables", "where", "words"),
    [
        ('motion]\nkind = "fourer"', "line 4, [excitation.motion] kind", "'fourier'"),
        ("motion]\nkind = 3", "line 4, [excitation.motion] kind", "kinds are fourier"),
        ("motion]\nperod = 3.0", "line 4, [excitation.motion] perod", "'period'"),
        ('motion]\nkind = "spline"\nperiod = 3.0', "[excitation.motion] period", "duration"),
        ('motion]\nkind = "spline"\ndurashun = 3.0', "[excitation.motion] durashun", "'duration'"),
        ('motion]\nkind = "spline"\npoints = 6', "[excitation.motion] points", "equal to 7"),
        ('motion]\nkind = "square"\nside = 0.3', "[excitation] motion", "add centre"),
        ("limits]\nvelocity = {elbow = -1}", "[excitation.limits.velocity] elbow", "than 0"),
        ("limits]\nefort = 3", "[excitation.limits] efort", "'effort'"),
        ('limits]\neffort = "none"', "[excitation.limits] effort", "'robot' or 'any'"),
        ("limits]\nshare = 1.1", "[excitation.limits] share", "less than or equal to 1"),
        ("workspace]\nbox = {x = [1.0]}", "[excitation.workspace.box] x", "2 entries"),
        ("criterion]\nweights = 'noize'", "[excitation.criterion] weights", "'noise'"),
    ],
)
def test_flaws(tables: str, where: str, words: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(f"[excitation.{tables}")
    assert where in caught.value.where
    assert words in caught.value.fix


def test_a_table_that_is_none() -> None:
    with pytest.raises(ModelError) as caught:
        read("[excitation]\nmotion = 3\n")
    assert caught.value.fix == "it should be a table"


def test_changes() -> None:
    section = read('[excitation.motion]\nkind = "spline"\npoints = 9\n')
    longer = changed_excitation(section, period=7.0, criterion="d_optimal", method="genetic")
    assert longer.motion.model_dump() == section.motion.model_dump() | {"duration": 7.0}
    assert (longer.criterion.kind, longer.search.method) == ("d_optimal", "genetic")
    assert changed_excitation(section, motion="spline").motion == section.motion
    assert changed_excitation(section, motion="fourier", harmonics=3).motion.harmonics == 3
    assert changed_excitation(section, still_unknown=True).criterion.after_earlier
    assert changed_excitation(section) == section
