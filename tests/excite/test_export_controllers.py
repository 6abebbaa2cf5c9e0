"""KRL and RAPID programs, read line by line as their controllers do, with REALs of 32 bits."""

import re
from typing import NamedTuple

import numpy as np
import pytest

from excite.exportable import NAMES, TOLERANCE, Swings, arm, motions
from steelyard.base.errors import OutputError
from steelyard.excite.controller_file_formats import exported

AXES = [f"A{k}" for k in range(1, 7)] + [f"E{k}" for k in range(1, 7)]


class Program(NamedTuple):
    """What a program does: the start posture and how fast it goes there; points and their times."""

    start: np.ndarray
    slow: float
    times: np.ndarray
    points: np.ndarray


def real(text: str) -> float:
    """A number of the controller, which has 24 bits."""
    return float(np.float32(text))


def posture(text: str) -> np.ndarray:
    """`{A1 1.0, A2 2.0}` in degrees and mm."""
    parts = [part.split() for part in text.strip("{}").split(",")]
    assert [name for name, _ in parts] == AXES[: len(parts)]
    return np.array([real(value) for _, value in parts])


def read_krl(text: str) -> Program:
    lines = [re.sub(r";.*", "", line).strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    assert lines[:3] == ["&ACCESS RVP", "DEF trajectory( )", "BAS(#INITMOV, 0)"]
    assert lines[-1] == "END"
    speed, start, slow, points, parts, total = 100.0, None, 0.0, [], [], 0.0
    inside = False
    for line in lines[3:-1]:
        if match := re.fullmatch(r"BAS\(#(VEL|ACC)_PTP, (\d+)\)", line):
            speed = float(match[2])
        elif match := re.fullmatch(r"PTP (\{.*\})", line):
            assert not inside and start is None
            start, slow = posture(match[1]), speed
        elif line in ("PTP_SPLINE", "ENDSPLINE"):
            inside = line == "PTP_SPLINE"
            assert speed == 100.0
        elif match := re.fullmatch(r"SPTP (\{.*\})", line):
            assert inside
            points.append(posture(match[1]))
        elif match := re.fullmatch(r"TIME_BLOCK (START|PART = (.*)|END = (.*))", line):
            assert inside and (match[1] != "START" or not points)
            parts += [real(match[2])] if match[2] else []
            total = real(match[3]) if match[3] else total
        else:
            raise AssertionError(f"no KRL: {line}")
    assert start is not None and not inside and len(parts) == len(points)
    times = np.cumsum([0.0, *parts]) / np.sum(parts) * total
    return Program(start, slow, times, np.array([start, *points]))


MOVE = re.compile(
    r"MoveAbsJ \[\[(.*?)\], \[(.*?)\]\]\\NoEOffs, v(\d+)(?:\\T:=([\d.]+))?, (\w+), tool0;"
)


def read_rapid(text: str) -> Program:
    lines = [re.sub(r"!.*", "", line).strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    assert re.fullmatch(r"MODULE \w+", lines[0]) and re.fullmatch(r"PROC \w+\(\)", lines[1])
    assert lines[-2:] == ["ENDPROC", "ENDMODULE"]
    override, moves = 100.0, []
    for line in lines[2:-2]:
        if match := re.fullmatch(r"VelSet (\d+), (\d+);", line):
            override = float(match[1])
            continue
        match = MOVE.fullmatch(line)
        assert match, f"no RAPID: {line}"
        axes = [match[1].split(", "), match[2].split(", ")]
        assert [len(part) for part in axes] == [6, 6]
        values = np.array([real(x) for part in axes for x in part if x != "9E9"])
        moves.append((values, float(match[3]) * override / 100.0, match[4], match[5]))
    assert moves[0][2] is None and moves[0][3] == moves[-1][3] == "fine"
    assert all(move[2] and move[3].startswith("z") for move in moves[1:-1])
    times = np.cumsum([0.0, *(float(move[2]) for move in moves[1:])])
    return Program(moves[0][0], moves[0][1], times, np.array([move[0] for move in moves]))


READERS = {"krl": read_krl, "rapid": read_rapid}


@pytest.mark.parametrize("form", READERS)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("joints", [6, 7])
def test_points_lie_on_the_motion_at_their_times(form: str, name: str, joints: int) -> None:
    robot = arm(joints)
    motion = motions(robot)[name]
    for rate in (None, 33.3):
        program = READERS[form](exported(motion, robot, form, rate))
        assert program.times[-1] == pytest.approx(motion.duration, abs=1e-4)
        even = np.linspace(0.0, motion.duration, len(program.times))
        np.testing.assert_allclose(program.times, even, atol=1e-4)
        assert np.diff(even).max() <= 1.0 / (rate or 10.0) + 1e-9
        wanted = motion.derivative(even, 0)
        assert np.abs(np.radians(program.points) - wanted).max() < TOLERANCE
        np.testing.assert_array_equal(program.start, program.points[0])
        assert program.slow <= 10.0


@pytest.mark.parametrize("form", READERS)
def test_prismatic_axes_are_in_millimetres(form: str) -> None:
    robot, motion = arm(7, 6), Swings(7)
    program = READERS[form](exported(motion, robot, form))
    t = np.linspace(0.0, motion.duration, len(program.times))
    assert np.abs(program.points[:, 6] * 1e-3 - motion.derivative(t, 0)[:, 6]).max() < TOLERANCE


def test_short_arms_have_fewer_axes_in_krl_and_none_in_rapid() -> None:
    assert read_krl(exported(Swings(3), arm(3), "krl")).points.shape[1] == 3
    with pytest.raises(OutputError, match="six axes.* this one has 3 joints"):
        exported(Swings(3), arm(3), "rapid")
    for form in READERS:
        with pytest.raises(OutputError, match="this one has 13 joints") as caught:
            exported(Swings(13), arm(13), form)
        assert "another format" in caught.value.fix


@pytest.mark.parametrize("form", READERS)
def test_programs_say_how_they_are_sampled(form: str) -> None:
    text = exported(Swings(), arm(), form, rate=20.0)
    points = len(READERS[form](text).times)
    assert text.isascii() and f"{points} points in degrees (prismatic axes: mm), 0.049" in text
    assert "Joints in this order: joint 1, joint 2, " in text
