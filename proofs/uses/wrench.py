"""External wrench without a sensor: pushed arms of the size of a UR10 and an RX-160, and a UR10e.

The arms are simulated by MuJoCo with friction that sticks; every standard parameter of their models
is off by 2 %. They are pushed with 30 N while they move, a tenth of a metre from the tool's origin.
J^-T is p3's estimate (its equation 8). Errors of forces are root mean squares over the three
components from the first to the last motion; where the condition number of the Jacobian is 100 or
less for comparison with J^-T, which has no bounds beyond. The UR10e moves without contact on days
on which its model was not fitted.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from proofs.robots.scores import identified, ur10e_logs
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.pushed_arms import (
    Arm,
    applied,
    arm_of,
    model_off,
    pushed_log,
    read,
    sudden,
    with_other_pushes,
)

import steelyard
from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.logs.formats import write_table
from steelyard.simulate.drives_sensors_and_loads import AppliedWrench
from steelyard.uses.wrench.wrench import ExternalWrench, MethodName

SEEDS = (0, 1, 2)
SINGULAR = 100.0
"""Condition number from which on a posture counts as singular."""

FREE = (
    "identification/ur-19_09_27-11_32_02",
    "identification/ur-19_10_01-14_04_41",
    "identification/ur-19_12_23_free",
    "identification/ur-20_01_31-unload",
    "validation/ur-20_01_17-ptp_10_points",
)
"""Logs of the UR10e without contact, of other days than its model's."""


OTHERS = (
    ("sudden pushes of 30 N for 0.3 s", 30.0, 0.3, 2.5),
    ("sudden pushes of 30 N for 6 s", 30.0, 6.0, 9.0),
    ("sudden pushes of 100 N for 1 s, 30 N expected", 100.0, 1.0, 5.0),
    ("20 N all the time", 20.0, 99.0, 99.0),
)
"""What, size [N], duration and time between [s]."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of wrenches along logs, where the arm moves.

    Attributes:
        error: Shape `(N, 6)` [N; Nm].
        inside: Whether the interval holds the truth, likewise.
        regular: Whether the Jacobian's condition number is at most `SINGULAR`, shape `(N,)`.
    """

    error: Array
    inside: Array
    regular: Array

    def rms(self, part: slice, regular: bool = False) -> float:
        """Root mean square over samples and components."""
        chosen = self.error[self.regular] if regular else self.error
        return float(np.sqrt(np.mean(np.square(chosen[:, part]))))

    def median(self, part: slice) -> float:
        """Of the lengths of force or moment errors over all samples."""
        return float(np.median(np.linalg.norm(self.error[:, part], axis=1)))


FORCE, MOMENT = slice(0, 3), slice(3, 6)


def _errors(found: ExternalWrench, true: AppliedWrench, moving: tuple[float, float]) -> Errors:
    estimate = found.estimate
    chosen = (estimate.t >= moving[0]) & (estimate.t <= moving[1])
    t = estimate.t[chosen]
    wanted = np.column_stack([np.interp(t, true.t, own) for own in true.values.T])
    error = estimate.wrench[chosen] - wanted
    inside = np.abs(error) <= estimate.half_width[chosen]
    return Errors(error, inside, estimate.condition[chosen] <= SINGULAR)


def _joined(parts: list[Errors]) -> Errors:
    return Errors(*(np.concatenate([getattr(p, name) for p in parts]) for name in vars(parts[0])))


def _arm_claims(problem: str, name: str, folder: Path) -> list[Claim]:
    methods: tuple[tuple[str, MethodName], ...] = (
        ("torque", "inverse"), ("momentum", "inverse"), ("momentum", "weighted"),
        ("momentum", "smoothed"),
    )  # fmt: skip
    parts: list[list[Errors]] = [[] for _ in methods]
    exact, largest = [], 0.0
    for seed in SEEDS:
        arm, log = arm_of(problem, seed), folder / f"{problem}{seed}.csv"
        true, model = pushed_log(arm, seed, log), model_off(arm, 100 + seed)
        run = read(model, log)
        for own, (residual, method) in zip(parts, methods, strict=True):
            found = steelyard.external_wrench(
                model, log, arm.frame, residual=residual, method=method, axes="base"
            )
            own.append(_errors(found, true, run.span))
        known = steelyard.external_wrench(model_off(arm, 0, 0.0), log, arm.frame, axes="base")
        exact.append(_errors(known, true, run.span))
        largest = max(largest, float(np.abs(found.wrench[:, :3]).max()))
    by_torque, by_momentum, weighted, smoothed, known = map(_joined, [*parts, exact])
    return _claims(name, by_torque, by_momentum, weighted, smoothed, known, largest)


def _other_pushes(problem: str, name: str, folder: Path) -> list[Claim]:
    """The same motions under pushes that are unlike those that the smoother expects."""
    claims = []
    for words, size, lasts, every in OTHERS:
        parts = []
        for seed in SEEDS:
            arm, log = arm_of(problem, seed), folder / f"{problem}{seed}.csv"
            model, other = model_off(arm, 100 + seed), folder / "other.csv"
            true = sudden(arm, size, lasts, every, seed)
            with_other_pushes(arm, log, applied(arm, seed), true, other)
            found = steelyard.external_wrench(model, other, arm.frame, axes="base")
            parts.append(_errors(found, true, read(model, other).span))
        errors = _joined(parts)
        force, held, bound = errors.rms(FORCE), float(errors.inside.mean()), max(3.5, 0.1 * size)
        claims.append(
            Claim(
                f"{name}: RMS force error, {words}; 95 % intervals hold",
                f"{force:.2f} N; {100.0 * held:.1f} %",
                f"<= {bound:g} N; >= 85 %",
                force <= bound and held >= 0.85,
            )
        )
    return claims


def _claims(
    name: str,
    by_torque: Errors,
    by_momentum: Errors,
    weighted: Errors,
    smoothed: Errors,
    exact: Errors,
    largest: float,
) -> list[Claim]:
    held = float(smoothed.inside.mean())
    singular = 100.0 * float(np.mean(~smoothed.regular))
    others = ", ".join(
        f"{kind} {one.rms(FORCE, regular=True):.2f}"
        for kind, one in (
            ("J^-T", by_torque), ("J^-T of the momentum", by_momentum), ("weighted", weighted),
        )
    )  # fmt: skip
    force = smoothed.rms(FORCE)
    vector = float(np.sqrt(3.0)) * force
    ratios = [
        Claim(
            f"{name}: {what} over that of J^-T (median; RMS where the condition number is <= 100)",
            f"{medians:.2f}; {squares:.2f}",
            "<= 0.6",
            medians <= 0.6 and squares <= 0.6,
        )
        for what, part in (("force error", FORCE), ("moment error", MOMENT))
        for medians in [smoothed.median(part) / by_torque.median(part)]
        for squares in [smoothed.rms(part, True) / by_torque.rms(part, True)]
    ]
    return [
        Claim(
            f"{name}: RMS force error per component, 30 N pushes (where regular: {others} N)",
            f"{force:.2f} N; {vector:.2f} N as a vector; moment {smoothed.rms(MOMENT):.2f} Nm",
            "<= 2 N",
            force <= 2.0,
        ),
        *ratios,
        Claim(
            f"{name}: force error over that with the true parameters in the model",
            f"{force / exact.rms(FORCE):.3f}",
            "<= 1.1",
            force <= 1.1 * exact.rms(FORCE),
        ),
        Claim(
            f"{name}: 95 % intervals hold", f"{100.0 * held:.1f} %", "90 to 98 %",
            0.90 <= held <= 0.98,
        ),
        Claim(
            f"{name}: finite, {singular:.0f} % of the motion with a condition number > 100",
            f"largest force {largest:.0f} N",
            "<= 90 N",
            largest <= 90.0,
        ),
    ]  # fmt: skip


def _free(model: IdentifiedModel) -> list[Claim]:
    """A real robot without contact."""
    folder = data_folder() / "ur10e"
    claims = []
    for name in FREE:
        found = steelyard.external_wrench(model, folder / f"{name}.parquet")
        zero = float(np.mean(np.abs(found.wrench) <= found.half_width))
        rms = float(np.sqrt(np.mean(np.sum(np.square(found.wrench[:, :3]), axis=1))))
        claims.append(
            Claim(
                f"UR10e without contact, {name.split('/')[1]}: intervals that hold zero",
                f"{100.0 * zero:.1f} %, RMS force {rms:.1f} N",
                ">= 90 %",
                zero >= 0.9,
            )
        )
    return claims


def _altered(model: IdentifiedModel, arm: Arm, log: Path, folder: Path) -> dict[str, Path]:
    """Logs that a wrench cannot be estimated from."""
    run = read(model, log)
    data = run.whole()
    motion = Motion(data.t, data.motion.q, data.motion.dq, data.motion.ddq)
    efforts = {
        "gravity-compensated": data.effort - model.gravity(motion.q),
        "link-side": data.effort - model.friction(motion),
        "slow": data.effort,
    }
    made = {}
    for name, effort in efforts.items():
        columns = {"t": motion.t}
        for kind, own in (("q", motion.q), ("dq", motion.dq), ("tau", effort)):
            columns |= {f"{kind}_{j + 1}": x for j, x in enumerate(own.T)}
        made[name] = folder / f"{name}.csv"
        step = 5 if name == "slow" else 1
        write_table(made[name], {key: x[::step] for key, x in columns.items()})
    return made


def _refused(folder: Path) -> list[Claim]:
    arm = arm_of("ur10", 0)
    model, log = model_off(arm, 100), folder / "ur100.csv"
    logs = _altered(model, arm, log, folder)
    cases = (
        (logs["gravity-compensated"], arm.frame, None, "% of the gravity that the model predicts"),
        (logs["link-side"], arm.frame, None, "% of the friction that the model predicts"),
        (log, "base_link", None, "is fixed to the base"),
        (logs["slow"], arm.frame, 8.0, "too few for a bandwidth of 8 Hz"),
    )
    claims = []
    for path, frame, bandwidth, words in cases:
        said = "not refused"
        try:
            steelyard.external_wrench(model, path, frame, bandwidth=bandwidth)
        except steelyard.SteelyardError as error:
            said = str(error).splitlines()[0]
        claims.append(Claim(f"{path.stem}, frame {frame}: refused", said, words, words in said))
    return claims


def main() -> list[Claim]:
    """Both arms, the UR10e, and logs that are refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        claims = _arm_claims("ur10", "UR10", folder)
        claims += _arm_claims("rx160", "RX-160", folder)
        claims += _other_pushes("ur10", "UR10", folder)
        claims += _other_pushes("rx160", "RX-160", folder)
        claims += _refused(folder)
        identified("ur10e", ur10e_logs(), [], output=folder / "model")
        return [*claims, *_free(steelyard.load_model(folder / "model"))]


if __name__ == "__main__":
    main_of(main)
