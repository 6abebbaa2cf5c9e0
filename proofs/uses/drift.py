"""Health: an arm that warms up for an hour and whose joint 3 wears in a week; one that does not.

The demo arm moves as in normal operation. On the first day the viscous friction of all joints falls
by 30 % within an hour (time constant 15 min), later days begin warm; over the week the Coulomb
friction of joint 3 doubles. Neither model knows the Stribeck friction that the arm has.
"""

import tempfile
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

import steelyard
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.model.model import ValuedModel
from steelyard.robot.robot import Robot
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.simulate import write_demo_arm
from steelyard.uses.health.health import Health

RATE = 50.0
FALL, CONSTANT = 0.3, 900.0
DAYS = 7
HOUR, SHORT = 3600.0, 420.0
STRIBECK, SLOW = 0.1, 0.1
VISCOUS = 0.6
NOISE = 0.01
JOINT = 2


def _motion(robot: Robot, seconds: float, seed: int) -> Motion:
    """Every joint swings with five frequencies of its own; their phases differ between logs."""
    task, rng = np.random.default_rng(7), np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / RATE)
    frequency = task.uniform(0.03, 0.35, (robot.n, 5))[..., None] * 2.0 * np.pi
    size = task.uniform(0.1, 0.25, (robot.n, 5))[..., None]
    phase = rng.uniform(0.0, 2.0 * np.pi, (robot.n, 5))[..., None]
    angle = frequency * t + phase
    q = np.sum(size * np.sin(angle), axis=1)
    dq = np.sum(size * frequency * np.cos(angle), axis=1)
    ddq = np.sum(-size * frequency**2 * np.sin(angle), axis=1)
    return Motion(t, q.T, dq.T, ddq.T)


def _only(valued: ValuedModel, *starts: str) -> ValuedModel:
    """The same with the parameters alone whose names begin like that."""
    kept = [name.startswith(starts) for name in valued.values.names]
    values = np.where(kept, valued.values.values, 0.0)
    model = valued.model
    return ValuedModel(model, Parameters(model.names, model.units, values))


def _with_viscous(valued: ValuedModel) -> ValuedModel:
    """The same with as much viscous friction at 1 rad/s as a share of the Coulomb friction."""
    known = valued.values.as_dict()
    dry = {n.replace("coulomb", "viscous"): x for n, x in known.items() if n.startswith("coulomb.")}
    values = [VISCOUS * dry[name] if name in dry else x for name, x in known.items()]
    model = valued.model
    return ValuedModel(model, Parameters(model.names, model.units, values))


def _log(
    path: Path, valued: ValuedModel, seconds: float, seed: int, viscous: float, coulomb: float
) -> str:
    """A log: viscous friction falls by a share from its start on, Coulomb friction has grown."""
    motion, rng = _motion(valued.model.robot, seconds, seed), np.random.default_rng(1000 + seed)
    dry = _only(valued, "coulomb.").torque(motion)
    warm = viscous * (1.0 - np.exp(-motion.t / CONSTANT)) if seconds == HOUR else viscous
    effort = valued.torque(motion)
    effort -= np.reshape(warm, (-1, 1)) * _only(valued, "viscous.").torque(motion)
    effort[:, JOINT] += coulomb * dry[:, JOINT]
    effort += STRIBECK * dry * np.exp(-np.square(motion.dq / SLOW))
    effort += NOISE * effort.std(axis=0) * rng.standard_normal(effort.shape)
    q = motion.q + 1e-5 * rng.standard_normal(effort.shape)
    dq = motion.dq + 1e-4 * rng.standard_normal(effort.shape)
    np.savez(path, time_s=motion.t, **_columns(q, dq, effort))
    return str(path)


def _columns(*signals: np.ndarray) -> dict[str, np.ndarray]:
    names = ("q{}_rad", "dq{}_rad_s", "tau{}_Nm")
    return {
        name.format(j + 1): x
        for name, signal in zip(names, signals, strict=True)
        for j, x in enumerate(signal.T)
    }


def _week(folder: Path, valued: ValuedModel, fall: float, wear: float) -> list[str]:
    """An hour from cold on the first day, some minutes of the warm arm on each later one."""
    logs = [_log(folder / "day1.npz", valued, HOUR, 11, fall, 0.0)]
    for day in range(2, DAYS + 1):
        grown = wear * (day - 1) / (DAYS - 1)
        logs.append(_log(folder / f"day{day}.npz", valued, SHORT, 10 + day, fall, grown))
    return logs


def _claims(found: Health, joints: tuple[str, ...], share: dict[str, float]) -> list[Claim]:
    """What was named, and how large; `share` is the model's viscous friction over the true one."""
    named = {(change.joint, change.quantity) for change in found.drifts}
    wanted = {(joint, "viscous friction") for joint in joints}
    wanted.add((joints[JOINT], "dry friction"))
    warm = [c for c in found.drifts if c.quantity == "viscous friction" and c.shape == "settles"]
    worn = [c for c in found.drifts if c.quantity == "dry friction" and c.shape == "drifts"]
    sizes = [100.0 * change.size * share[change.joint] for change in warm]
    times = [(change.time or 0.0) / 60.0 for change in warm]
    fallen = 100.0 * FALL * (1.0 - np.exp(-HOUR / CONSTANT))
    grown = 100.0 * worn[0].size if worn else 0.0
    span = worn[0].logs if worn else ("", "")
    least, most = (f(sizes, default=0.0) for f in (min, max))
    short, long = (f(times, default=0.0) for f in (min, max))
    return [
        Claim(
            "drifts named: viscous of all joints, Coulomb of joint 3, no other",
            f"{len(named)}, {len(named - wanted)} wrong",
            f"{len(wanted)}, 0 wrong",
            named == wanted,
        ),
        Claim(
            f"fall of viscous friction in {len(warm)} joints, true {fallen:.0f} %",
            f"{least:.1f} to {most:.1f} %",
            "within 6 points",
            len(warm) == len(joints) and all(abs(size + fallen) < 6.0 for size in sizes),
        ),
        Claim(
            f"its time constant, true {CONSTANT / 60.0:.0f} min",
            f"{short:.0f} to {long:.0f} min",
            "within a factor of 1.5",
            all(1 / 1.5 < 60.0 * time / CONSTANT < 1.5 for time in times) and bool(times),
        ),
        Claim(
            "growth of joint 3's Coulomb friction, true 100 %",
            f"{grown:.0f} %, {span[0]} to {span[1]}",
            "within 15 points, day1 to day7",
            abs(grown - 100.0) < 15.0 and span == ("day1", f"day{DAYS}"),
        ),
    ]


def main() -> list[Claim]:
    """Both arms."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        loaded = write_demo_arm(folder)
        truth = random_truth(loaded.robot, 0)
        valued = _with_viscous(truth.model.at(truth.values))
        fits = [_log(folder / f"fit{k}.npz", valued, 90.0, k, 0.0, 0.0) for k in (1, 2)]
        model = steelyard.identify(folder / "demo_arm.toml", fits, check=False).model
        joints = loaded.robot.joint_names
        found = steelyard.health(model, _week(folder, valued, FALL, 1.0))
        steady = steelyard.health(model, _week(folder, valued, 0.0, 0.0))
        drifts = [f"{c.joint} {c.quantity} {c.text}" for c in steady.drifts]
        none = Claim(
            "drifts of the same arm without drift", "; ".join(drifts) or "none", "none", not drifts
        )
        fitted, true = model.estimate.parameters.as_dict(), valued.values.as_dict()
        share = {j: fitted[f"viscous.{j}"] / true[f"viscous.{j}"] for j in joints}
        return [*_claims(found, joints, share), none]


if __name__ == "__main__":
    main_of(main)
