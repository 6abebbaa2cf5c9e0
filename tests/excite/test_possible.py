"""Tables that allow no motion: the message, and that the change that is advised works."""

import re
from pathlib import Path

import pytest

from excite.colliding import link, urdf, written
from excite.tabled import OPEN, QUICK, designed, some_motion
from steelyard.base.errors import SteelyardError

FREE = f'{OPEN}[excitation.limits]\neffort = "any"\n'


def refused(folder: Path, tables: str) -> SteelyardError:
    with pytest.raises(SteelyardError) as caught:
        some_motion(folder, tables)
    return caught.value


def numbers(text: str) -> list[float]:
    return [float(x) for x in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (
            "period = {}\nharmonics = 6",
            "a period of 0.06 s is too short for 6 harmonics: at 100 Hz",
        ),
        ('kind = "raw_fourier"\nperiod = {}', "a period of 0.06 s is too short for 5 harmonics"),
        ('kind = "ramped_fourier"\nperiod = 9.0\nramp = {}', "a period of 9 s and a ramp of 0.06"),
        ('kind = "blended_fourier"\nblend = {}', "a blend of 0.06 s is too short for the motion"),
        ('kind = "spline"\nduration = {}', "a duration of 0.06 s is too short for the motion"),
        ('kind = "reaching"\nmove = {}', "a move of 0.06 s is too short for the motion"),
    ],
)
def test_times_that_are_too_short(tmp_path: Path, tables: str, words: str) -> None:
    head = f"{FREE}acceleration = 1.0\n[excitation.motion]\n"
    error = refused(tmp_path, head + tables.format("0.06"))
    assert words in error.wrong and "no joint can move by even 0.002 rad" in error.wrong
    assert error.where == "[excitation.motion]"
    times = dict(re.findall(r"(\w+) = ([\d.]+)", error.fix))
    changed = tables.format("0.06")
    for key, seconds in times.items():
        changed = re.sub(rf"\b{key} = [\d.]+", f"{key} = {seconds}", changed)
    some_motion(tmp_path, head + changed)
    shorter = {key: 0.98 * float(seconds) for key, seconds in times.items()}
    for key, value in shorter.items():
        changed = re.sub(rf"\b{key} = [\d.]+", f"{key} = {value}", changed)
    refused(tmp_path, head + changed)


def test_fewer_harmonics_work_too(tmp_path: Path) -> None:
    tables = f"{FREE}acceleration = 1.0\n[excitation.motion]\nperiod = 2.0\nharmonics = {{}}\n"
    error = refused(tmp_path, tables.format(20))
    most = int(re.findall(r"no more than (\d+) harmonics", error.fix)[0])
    some_motion(tmp_path, tables.format(most))
    refused(tmp_path, tables.format(most + 1))


def test_jerk_counts_as_acceleration_does(tmp_path: Path) -> None:
    tables = f"{FREE}jerk = 0.01\n[excitation.motion]\nperiod = {{}}\n"
    error = refused(tmp_path, tables.format("10.0"))
    some_motion(tmp_path, tables.format(re.findall(r"period = ([\d.]+)", error.fix)[0]))


@pytest.mark.parametrize("key", ["start", "end"])
@pytest.mark.parametrize(
    ("at", "words"),
    [
        ("2.7", "'boom_joint' at 2.7 rad: this is 0.3 rad above its upper limit of 2.4 rad"),
        ("-2.45", "'boom_joint' at -2.45 rad: this is 0.05 rad below its lower limit of -2.4 rad"),
        ("2.4", "'boom_joint' at 2.4 rad: this is on its limit of 2.4 rad"),
    ],
)
def test_postures_outside_limits(tmp_path: Path, key: str, at: str, words: str) -> None:
    other = "" if key == "start" else "start = [0.0, 0.0, 0.0]\n"
    tables = f"{FREE}[excitation.motion]\n{other}{key} = {{boom_joint = {{}}}}\n"
    error = refused(tmp_path, tables.replace("{}", at))
    assert words in error.wrong and f"the {key} posture" in error.wrong
    assert error.where == f"[excitation.motion] {key}"
    assert ("position_margin" in error.fix) == (abs(float(at)) < 2.5)
    low, high = numbers(error.fix)[:2]
    some_motion(tmp_path, tables.replace("{}", str(low if float(at) < 0.0 else high)))


def test_less_margin_lets_a_posture_be(tmp_path: Path) -> None:
    tables = "[excitation.motion]\nstart = [0.0, 2.45, 0.0]\n"
    refused(tmp_path, FREE + tables)
    some_motion(tmp_path, f"{FREE}position_margin = 0.0\n{tables}")


CELL = urdf(link("wall", '<box size="0.1 2 2"/>', xyz="0.6 0 0.5"), name="cell")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("walls", "start", "words"),
    [
        ('[excitation.collision]\nworld = "cell.urdf"\n', [0.0, 0.0, 0.0], "'stick' and 'wall'"),
        ("[excitation.collision]\n", [0.0, 0.0, 2.35], "'stick'"),
        (
            f"{OPEN}[excitation.workspace]\nbox = {{z = [0.5, 1.0]}}\n",
            [0.0, 1.2, 0.0],
            "z of 'tool' above 0.5 m (violated by 0.7",
        ),
    ],
)
def test_a_start_in_collision_or_out_of_its_box(
    tmp_path: Path, walls: str, start: list[float], words: str
) -> None:
    written(tmp_path, CELL, "cell.urdf")
    error = refused(tmp_path, f"{walls}[excitation.motion]\nstart = {start}\n")
    assert "the start posture violates" in error.wrong and words in error.wrong
    assert "violated by" in error.wrong and error.where == "[excitation.motion] start"
    advised = re.findall(r"\[.*\]", error.fix)[0]
    some_motion(tmp_path, f"{walls}[excitation.motion]\nstart = {advised}\n")


@pytest.mark.parametrize(
    ("tables", "at", "words"),
    [
        (f"{FREE}[excitation.workspace]\nbox = {{z = [{{}}, 3.0]}}\n", 2.0, "z of 'tool' above"),
        (f"{FREE}[excitation.workspace]\nbox = {{x = [{{}}, 3.0]}}\n", 1.2, "x of 'tool' above"),
        (
            f"{FREE}[excitation.workspace]\nonly_tool = true\n"
            "planes = [{normal = [0, 0, 1], above = {}}]\n",
            1.5,
            "'tool' above plane 1",
        ),
    ],
)
def test_a_box_out_of_reach(tmp_path: Path, tables: str, at: float, words: str) -> None:
    error = refused(tmp_path, tables.replace("{}", str(at)))
    assert "no posture was found that satisfies all constraints" in error.wrong
    assert words in error.wrong and words in error.fix
    missed = float(re.findall(r"violated by ([\d.]+) m", error.wrong)[0])
    amount = float(re.findall(r"by ([\d.]+) m, or more", error.fix)[0])
    assert missed < amount < missed + 0.1
    some_motion(tmp_path, tables.replace("{}", str(at - amount)))
    refused(tmp_path, tables.replace("{}", str(at - 0.99 * missed)))


@pytest.mark.slow
def test_power_that_allows_no_motion(tmp_path: Path) -> None:
    limits = 'share = 1.0\neffort = "any"\npower = '
    tables = f"{OPEN}[excitation.limits]\n{limits}{{}}\n"
    error = refused(tmp_path, tables.format(1e-6))
    assert "power of" in error.wrong and "of the joints' ranges" in error.wrong
    assert error.where == "[excitation] power"
    amounts = [float(x) for x in re.findall(r"by ([\d.]+) W", error.fix)]
    some_motion(tmp_path, tables.format(1e-6 + max(amounts)))


def test_effort_that_does_not_hold_the_arm(tmp_path: Path) -> None:
    start = "[excitation.motion]\nstart = [0.0, 0.0, 0.0]\n"
    tables = f"{OPEN}[excitation.limits]\nshare = 1.0\neffort = {{}}\n{start}"
    error = refused(tmp_path, tables.format(2.0))
    assert "the start posture violates: torque of 'boom_joint'" in error.wrong
    missed = float(re.findall(r"violated by ([\d.]+) Nm", error.wrong)[0])
    # masses of 1 kg at the origins of 'stick' and 'tool'
    assert missed == pytest.approx(9.81 * (0.3 + 0.65) - 2.0, rel=0.01)
    some_motion(tmp_path, tables.format(2.0 + 1.1 * missed))


@pytest.mark.parametrize("kind", ["fourier", "spline"])
def test_ends_too_far_apart_for_the_time(tmp_path: Path, kind: str) -> None:
    key = "period" if kind == "fourier" else "duration"
    tables = (
        f'{FREE}[excitation.motion]\nkind = "{kind}"\n{key} = {{}}\n'
        "start = [-2.0, 0.0, 0.0]\nend = [2.0, 0.0, 0.0]\n"
    )
    error = refused(tmp_path, tables.format("1.0"))
    needed = float(re.findall(r"takes ([\d.]+) s, the motion has 1 s", error.wrong)[0])
    advised = float(re.findall(r"more than ([\d.]+) s", error.fix)[0])
    # a minimum-jerk move, near which the splines are: 15/8 of the mean speed, 10/sqrt(3) of the
    # way over the time squared
    speed, acceleration = 0.95 * 3.0, 0.95 * 5.0
    least = max(1.875 * 4.0 / speed, (10.0 / 3.0**0.5 * 4.0 / acceleration) ** 0.5)
    assert needed == pytest.approx(least, rel=3e-3 if kind == "fourier" else 0.1)
    assert needed <= 1.001 * advised and advised < 1.01 * needed
    some_motion(tmp_path, tables.format(advised))


@pytest.mark.parametrize(
    ("tables", "where", "words"),
    [
        ("[excitation.limits]\nposition_margin = 2.6\n", "position_margin", "below 2.5"),
        ("[excitation.limits]\nvelocity = [1.0, 2.0]\n", "velocity", "one per joint"),
        ("[excitation.limits]\njerk = {bom_joint = 1.0}\n", "jerk", "'boom_joint'"),
        ("[excitation.limits]\neffort = {bom_joint = 1.0}\n", "effort", "'boom_joint'"),
        ("[excitation.motion]\nstart = [0.0]\n", "[excitation.motion]", "one number per joint"),
        ("[excitation.motion]\nstart = {bom_joint = 0.0}\n", "[excitation.motion]", "'boom_joint'"),
        ("[excitation.motion]\nend = [0.0, 0.0, 0.0]\n", "[excitation.motion]", "start = [...]"),
        ("[excitation.workspace]\nframe = 'tol'\n", "workspace] frame", "'tool'"),
        ("[excitation.workspace]\nbox = {x = [0.2, 0.1]}\n", "workspace] box", "lower bound"),
        (
            "[excitation.workspace]\nkeep_out = [{x = [0.1, 0.2]}]\n",
            "workspace] keep_out",
            "x, y and z",
        ),
        (
            "[[excitation.workspace.planes]]\nnormal = [0, 0, 0]\nabove = 0\n",
            "workspace] planes",
            "the free side",
        ),
        ("[excitation.collision]\nworld = 'nowhere.urdf'\n", "nowhere.urdf", "'arm.urdf'"),
        ("[excitation.collision]\nignore = [['bom', 'stick']]\n", "'bom', 'stick'", "'boom'"),
        ("[excitation.collision]\nwithout = ['bom']\n", "arm.urdf", "'boom'"),
        ("[excitation.criterion]\nkind = 'd_optimol'\n", "criterion] kind", "'d_optimal'"),
        ("[excitation.criterion]\nchosen = ['viscos']\n", "criterion] chosen", "'viscous'"),
        ("[excitation.criterion]\nchosen = []\n", "criterion] chosen", "viscous"),
        ("[excitation.criterion]\nweights = [1.0]\n", "criterion] weights", "one number per joint"),
        ("[excitation.criterion]\nweights = 'noise'\n", "criterion] weights", "--earlier"),
        ("[excitation.criterion]\nrelative = true\n", "criterion] relative", "--earlier"),
        ("[excitation.criterion]\nafter_earlier = true\n", "after_earlier", "--earlier"),
        ("[[excitation.loads]]\nmass = 1.0\nframe = 'tol'\n", "loads] frame", "'tool'"),
        ("[excitation.search]\nmethod = 'gradiant'\n", "search] method", "'gradient'"),
    ],
)
def test_what_does_not_fit_the_robot(tmp_path: Path, tables: str, where: str, words: str) -> None:
    with pytest.raises(SteelyardError) as caught:
        designed(tmp_path, tables)
    assert where in caught.value.where
    assert words in caught.value.fix
    assert QUICK not in tables
