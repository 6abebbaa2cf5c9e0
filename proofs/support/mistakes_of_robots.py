"""Mistakes of what was logged: other robots, loads, motions, models and laws."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from proofs.support.mistakes import Arm, Job, Log, Mistake
from proofs.support.mistakes_planted import named

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.simulate.ground_truth import random_truth


def validated_by(change: Callable[[Arm, Job], Log]) -> Callable[[Arm], Job]:
    """The clean job with another log to be predicted."""

    def plant(arm: Arm) -> Job:
        job = arm.plain()
        return replace(job, unseen=change(arm, job))

    return plant


def float32(log: Log) -> Log:
    """A log stored with less digits."""
    less = [np.asarray(x, dtype=np.float32).astype(float) for x in (log.q, log.tau)]
    dq = None if log.dq is None else log.dq.astype(np.float32).astype(float)
    return Log(log.t, less[0], less[1], dq)


def by_torque(
    torque: Callable[[Arm, int, Motion], Array], *, measured: bool = True
) -> Callable[[Arm], Job]:
    """Logs with other true torques; or with efforts that are these, without noise."""

    def plant(arm: Arm) -> Job:
        logs = []
        for k in range(3):
            m = arm.motion(k)
            tau = torque(arm, k, m)
            log = arm.log(m, k, tau)
            logs.append(log if measured else replace(log, tau=tau))
        return Job((logs[0], logs[1]), logs[2], arm.robot_file, arm.urdf)

    return plant


def nominal(arm: Arm, k: int, m: Motion) -> Array:
    """What a controller computes from the model file."""
    prior = arm.truth.model.prior
    if prior is None:
        raise ValueError("the model file has no masses")
    return prior.torque(m)


def computed_when_fitted(arm: Arm) -> Job:
    """Fitted logs hold computed efforts, the one to be predicted measured ones."""
    job = by_torque(nominal, measured=False)(arm)
    return replace(job, unseen=arm.plain().unseen)


def carrying(mass: float, *logs: int) -> Callable[[Arm], Job]:
    """A load in some of the logs."""

    def torque(arm: Arm, k: int, m: Motion) -> Array:
        return arm.torque(m, arm.loaded(mass) if k in logs else None)

    return by_torque(torque)


def picked_up(arm: Arm, k: int, m: Motion) -> Array:
    """A load from the middle of the first log."""
    tau = arm.torque(m)
    if k == 0:
        tau[len(tau) // 2 :] = arm.torque(m, arm.loaded(2.0))[len(tau) // 2 :]
    return tau


def jump(arm: Arm, k: int, m: Motion) -> Array:
    """The offset of two joints jumps in the middle of every log."""
    tau = arm.torque(m)
    for joint in arm.joints[:2]:
        tau[len(tau) // 2 :, joint] += 0.3 * np.std(tau[:, joint])
    return tau


def another_robot(*logs: int) -> Callable[[Arm], Job]:
    """Some of the logs are of another robot of the series."""

    def torque(arm: Arm, k: int, m: Motion) -> Array:
        return arm.torque(m, random_truth(arm.robot, arm.seed + 77) if k in logs else None)

    return by_torque(torque)


def warming(arm: Arm, k: int, m: Motion) -> Array:
    """Friction that falls by 60 % over every log."""
    share = np.linspace(0.0, 0.6, len(m))[:, None]
    return arm.torque(m) - share * friction(arm, m)


def friction(arm: Arm, m: Motion) -> Array:
    """Coulomb and viscous friction of the truth, shape `(N, n)` [Nm]."""
    still = arm.truth.changed(
        **{
            name: 0.0
            for name in arm.truth.values.names
            if name.startswith(("coulomb.", "viscous."))
        }
    )
    return arm.torque(m) - arm.torque(m, still)


def stribeck(arm: Arm, k: int, m: Motion) -> Array:
    """Friction that is higher near rest."""
    fc = np.array([arm.truth.values[f"coulomb.{name}"] for name in arm.robot.joint_names])
    return arm.torque(m) + 1.5 * fc * np.sign(m.dq) * np.exp(-((m.dq / 0.2) ** 2))


def load_dependent(arm: Arm, k: int, m: Motion) -> Array:
    """Friction that grows with the torque that is passed on."""
    tau = arm.torque(m)
    return tau + 0.2 * np.abs(tau) * np.sign(m.dq)


def uncompensated(arm: Arm, k: int, m: Motion) -> Array:
    """Efforts less gravity, as some controllers report them."""
    tens = arm.truth.changed(
        **{
            name: 0.0
            for name in arm.truth.values.names
            if name.startswith(("coulomb.", "viscous.", "offset."))
        }
    )
    still = Motion(m.t, m.q, 0.0 * m.dq, 0.0 * m.ddq)
    return arm.torque(m) - arm.torque(still, tens)


def zero_offset(*offsets: tuple[int, float]) -> Callable[[Arm], Job]:
    """Encoders that count from elsewhere; see `Arm.joint`."""

    def plant(arm: Arm) -> Job:
        shift = np.zeros(arm.robot.n)
        for k, value in offsets:
            shift[arm.joint(k)] = value
        return arm.plain().every(lambda log: replace(log, q=log.q + shift))

    return plant


def urdf(pattern: str, new: Callable[[str], str]) -> Callable[[Arm], Job]:
    """The clean logs with a model file in which all that the pattern finds is otherwise."""

    def plant(arm: Arm) -> Job:
        text, count = re.subn(pattern, lambda found: new(found.group()), arm.urdf)
        if not count:
            raise ValueError(f"the model file has no {pattern}")
        return replace(arm.plain(), urdf=text)

    return plant


def heavier(factor: float) -> Callable[[Arm], Job]:
    """Masses and inertias of the model file that are wrong by a factor."""

    def scaled(tag: str) -> str:
        return re.sub(
            r'(value|i[xyz]{2})="([-\d.]+)"',
            lambda m: f'{m.group(1)}="{factor * float(m.group(2)):.6g}"',
            tag,
        )

    return urdf(r"<(mass|inertia) [^>]*>", scaled)


def gravity(text: str) -> Callable[[Arm], Job]:
    """A robot file that says that gravity points elsewhere."""
    return lambda arm: arm.plain().toml(
        'urdf = "demo_arm.urdf"\n', f'urdf = "demo_arm.urdf"\ngravity = {text}\n'
    )


def tau_columns(arm: Arm) -> Job:
    """Columns called `tau1`, and no robot file: of motors, or on the link side?"""
    return named(arm.plain(), "t", "q{}", "dq{}", "tau{}")


UPPER, FOREARM = '"0 0 0.360"', '"0 -0.060 0.260"'
COMPUTED = r"(check|headline|refusal).*(noise-free|computed|no noise|without noise)"
ZERO = r"(check|headline|refusal).*zero offset of \w+ -?\d"
LOAD = r"(headline|refusal|check wrong|validate).*(payload|carries|load)"
REPEATED = r"(headline|validate|note|refusal|check).*(repeat|same motion|same samples|is fitted)"
OTHER = r"(another|other|different) robot|not the same robot|robots? differ|two robots"
LACKS = r"headline.*(link length|axis of joint|geometry)"
RESIDUALS = r"headline.*residuals.*noise.*friction"

OTHER_MASSES = r"doubtful effort kind.*or the links are"  # or efforts off by that: one log of both

ROBOTS: list[Mistake] = [
    Mistake("model file 3 x too heavy", heavier(3.0), OTHER_MASSES),
    Mistake("model file 3 x too light", heavier(1.0 / 3.0), OTHER_MASSES),
    Mistake("clean, zero of the first joint", zero_offset((-1, 0.3))),
    Mistake("computed efforts", by_torque(nominal, measured=False), COMPUTED),
    Mistake(
        "computed efforts, true model",
        by_torque(lambda arm, k, m: arm.torque(m), measured=False),
        COMPUTED,
    ),
    Mistake("computed efforts when fitted", computed_when_fitted, COMPUTED),
    Mistake("validated by a copy", validated_by(lambda arm, job: job.fitted[0]), REPEATED),
    Mistake(
        "validated by a copy less a row",
        validated_by(lambda arm, job: job.fitted[0].rows(slice(1, None))),
        REPEATED,
    ),
    Mistake(
        "validated by every other row",
        validated_by(lambda arm, job: job.fitted[0].rows(slice(None, None, 2))),
        REPEATED,
    ),
    Mistake(
        "validated by float32", validated_by(lambda arm, job: float32(job.fitted[0])), REPEATED
    ),
    Mistake(
        "validated by a copy, later stamps",
        validated_by(lambda arm, job: replace(job.fitted[0], t=job.fitted[0].t + 12.3)),
        REPEATED,
    ),
    Mistake(
        "validated by the second half",
        validated_by(lambda arm, job: job.fitted[1].rows(slice(2000, None))),
        REPEATED,
    ),
    Mistake(
        "validated by the motion once more",
        validated_by(lambda arm, job: arm.log(arm.motion(0), 55)),
        REPEATED,
    ),
    Mistake("payload of 2.5 kg in all logs", carrying(2.5, 0, 1, 2), LOAD),
    Mistake("payload of 1 kg in all logs", carrying(1.0, 0, 1, 2), LOAD),
    Mistake("payload in one fitted log", carrying(2.0, 1), LOAD),
    Mistake("payload picked up", by_torque(picked_up), LOAD),
    Mistake("payload when validated", carrying(2.0, 2), r"(validate|note).*carries.* kg"),
    Mistake("offsets jump", by_torque(jump), "(wrong|doubtful|headline).*(jump|offset|step)"),
    Mistake("two robots", another_robot(1), OTHER),
    Mistake("another robot when validated", another_robot(2), OTHER),
    *(
        Mistake(f"zero of joint {k + 1} off by {size}", zero_offset((k, size)), ZERO)
        for k, size in ((0, 0.05), (0, 0.5), (1, 0.1), (2, 0.2), (3, 0.1), (3, 0.5))
    ),
    Mistake(
        "zero of the last joint off by 0.2",
        zero_offset((-2, 0.2)),
        untold="it turns the last link's parameters, and no torque tells the two apart",
    ),
    Mistake("zeros of three joints", zero_offset((0, 0.05), (1, -0.1), (2, 0.1)), ZERO),
    *(
        Mistake(
            f"upper arm {percent} % longer",
            urdf(UPPER, lambda _, p=percent: f'"0 0 {0.36 * (1 + p / 100):.5f}"'),
            LACKS,
        )
        for percent in (5, 20, 50)
    ),
    Mistake("forearm 20 % longer", urdf(FOREARM, lambda _: '"0 -0.060 0.312"'), LACKS),
    Mistake(
        "an axis is another",
        urdf(
            r'<child link="hand"/>\s+<origin[^>]*>\s+<axis xyz="0 1 0"/>',
            lambda old: old.replace('"0 1 0"', '"1 0 0"'),
        ),
        rf"{LACKS}|headline.*axis of the next joint",
        "joint order|mounting",
    ),
    Mistake("mounted on a wall", gravity("[9.81, 0.0, 0.0]"), "wrong mounting"),
    Mistake("mounted on a ceiling", gravity("[0.0, 0.0, 9.81]"), "wrong (mounting|effort sign)"),
    Mistake("tilted by 20 degrees", gravity("[3.355, 0.0, -9.218]"), "mounting"),
    Mistake("efforts without gravity", by_torque(uncompensated), "wrong (effort kind|mounting)"),
    Mistake(
        "efforts without friction",
        by_torque(lambda arm, k, m: arm.torque(m) - friction(arm, m)),
        untold="a robot without friction could be real; friction comes out as zero",
    ),
    Mistake("friction falls by 60 %", by_torque(warming), RESIDUALS + "|drift|between the parts"),
    Mistake("friction with Stribeck effect", by_torque(stribeck), RESIDUALS),
    Mistake("friction grows with load", by_torque(load_dependent), RESIDUALS),
    Mistake("columns tau, no robot file", tau_columns, "note: .*(on the link side|rotor|motor)"),
]
