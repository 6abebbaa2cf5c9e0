"""A joint without a motor: declared, proposed by `init`, its equation used by `identify`."""

import os
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.base.errors import ModelError
from steelyard.identify.identify import identify
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.init.draft_robot_file import assigned, drafted, proposed
from steelyard.runs.runs_of_named_logs import load_runs, sample_of

pytestmark = pytest.mark.usefixtures("few_stretches")

MASS, LENGTH, INERTIA, DAMPING, GRAVITY = 0.8, 0.35, 0.03, 0.02, 9.81
CART, DRAG = 1.5, 2.0

URDF = """<robot name="cart_pole">
<link name="rail"/>
<link name="cart"><inertial><mass value="2.0"/><origin xyz="0 0 0"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="pole"><inertial><mass value="1.0"/><origin xyz="0 0 -0.3"/>
<inertia ixx="0.03" iyy="0.03" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="5" effort="60"/></joint>
<joint name="swing" type="continuous"><parent link="cart"/><child link="pole"/>
<axis xyz="0 -1 0"/><limit velocity="30" effort="5"/></joint>
</robot>"""


def swing(seed: int, rate: float = 200.0, seconds: float = 20.0) -> pl.DataFrame:
    """A cart that is pushed, with a pole that hangs from it, integrated by Runge and Kutta."""
    rng, h = np.random.default_rng(seed), 1.0 / rate
    size, turn = rng.uniform(2.0, 5.0, 5), 2.0 * np.pi * rng.uniform(0.2, 1.6, 5)
    phase = rng.uniform(0.0, 2.0 * np.pi, 5)

    def push(t: float, x: np.ndarray) -> float:
        return float(size @ np.sin(turn * t + phase)) - 15.0 * x[0]

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        _, angle, v, w = x
        c, s = np.cos(angle), np.sin(angle)
        matrix = [[CART + MASS, MASS * LENGTH * c], [MASS * LENGTH * c, INERTIA + MASS * LENGTH**2]]
        right = [
            push(t, x) - DRAG * v + MASS * LENGTH * s * w * w,
            -MASS * GRAVITY * LENGTH * s - DAMPING * w,
        ]
        return np.concatenate((x[2:], np.linalg.solve(matrix, right)))

    x, rows = np.zeros(4), []
    for k in range(int(rate * seconds)):
        t = k * h
        rows.append([t, *x, push(t, x)])
        a = slope(t, x)
        b = slope(t + h / 2, x + h / 2 * a)
        c = slope(t + h / 2, x + h / 2 * b)
        d = slope(t + h, x + h * c)
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    table = np.array(rows)
    table[:, 1:3] += 2e-5 * rng.normal(size=(len(table), 2))
    table[:, 5] += 0.02 * rng.normal(size=len(table))
    found = {"t": table[:, 0], "q_slide": table[:, 1], "q_swing": table[:, 2]}
    return pl.DataFrame(found | {"tau_slide": table[:, 5], "tau_swing": np.zeros(len(table))})


@pytest.fixture(scope="module")
def swings() -> dict[str, pl.DataFrame]:
    """Two logs."""
    return {name: swing(seed) for name, seed in (("one", 1), ("two", 2))}


@pytest.fixture
def cart_pole(tmp_path: Path, swings: dict[str, pl.DataFrame]) -> Path:
    """A robot file as `init` writes it, and two logs beside it."""
    (tmp_path / "cart_pole.urdf").write_text(URDF)
    for name, table in swings.items():
        table.write_csv(tmp_path / f"{name}.csv")
    proposal = proposed(str(tmp_path / "cart_pole.urdf"))
    columns, sample = sample_of(tmp_path / "one.csv")
    path = tmp_path / "robot.toml"
    path.write_text(drafted(proposal, assigned(proposal, columns, sample), path).text)
    return path


def test_init_proposes_a_joint_whose_effort_is_always_zero(cart_pole: Path) -> None:
    text = cart_pole.read_text()
    assert '\nunactuated = ["swing"]' in text and "no motor drives swing" in text
    signals = load_robot(cart_pole).signals
    assert signals is not None and signals.unactuated == (1,)


def test_no_column_is_needed(cart_pole: Path) -> None:
    text = cart_pole.read_text().replace('["tau_slide", "tau_swing"]', '["tau_slide"]')
    folder = cart_pole.parent
    other = folder / "other.toml"
    other.write_text(text)
    pl.read_csv(folder / "one.csv").drop("tau_swing").write_csv(folder / "few.csv")
    (run,) = load_runs(other, folder / "few.csv")
    effort = run.whole().effort
    assert not effort[:, 1].any() and effort[:, 0].std() > 1.0


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ('unactuated = ["hinge"]', "'hinge' is none of the identified joints"),
        ('unactuated = ["swing", "slide"]', "no joint has a motor"),
    ],
)
def test_what_cannot_be_is_refused(cart_pole: Path, line: str, wrong: str) -> None:
    text = cart_pole.read_text().replace('unactuated = ["swing"]', line)
    cart_pole.write_text(text)
    with pytest.raises(ModelError, match=wrong):
        load_robot(cart_pole)


@pytest.mark.slow
def test_the_equation_of_a_free_joint_is_used(cart_pole: Path) -> None:
    folder = cart_pole.parent
    found = identify(cart_pole, folder / "one.csv", folder / "two.csv", check=False)
    (unseen,) = found.to_dict()["validation"]
    slide, free = unseen["headline"]["joints"]
    assert slide["percent_of_used"] < 4.0
    assert free["percent_of_used"] is None and not free["moving"] and free["error"] < 0.05
    values = found.model.estimate.parameters.as_dict()
    assert values["mz.pole"] == pytest.approx(-MASS * LENGTH, rel=0.05)
    assert values["viscous.swing"] == pytest.approx(DAMPING, rel=0.3)


@pytest.mark.slow
def test_a_rotary_pendulum_is_identified_with_its_free_joint() -> None:
    data = os.environ.get("STEELYARD_DATA")
    folder = Path(data or "").parent / "cases" / "passive-joint"
    if data is None or not folder.is_dir():
        pytest.skip("there is no folder cases/passive-joint beside the folder of STEELYARD_DATA")
    found = identify(folder / "furuta.urdf", folder / "run1.csv", folder / "run2.csv", check=False)
    (unseen,) = found.to_dict()["validation"]
    assert unseen["headline"]["pooled"][0]["percent_of_used"] < 4.0
