"""Contact on a real UR10e: false alarms on other days, pushes by hand, contact while calibrating.

Run by itself it prints a table of the pushes: delay, joint, size, link.

Thresholds come from the runs that were left out in turn when the model was identified (February
2020); unseen motion is of four months before, pushes of January.
"""

import tempfile
from pathlib import Path

import numpy as np
from proofs.robots.scores import EXAMPLES, identified, ur10e_logs
from proofs.support.claims import Claim, data_folder, main_of

import steelyard
from steelyard.estimate.identified_model import IdentifiedModel

RATE = 6.0
"""False alarms per hour: one in ten minutes."""

DISPLACED = 4e-4
"""Displacement of a joint of the resting robot that is a push [rad]."""

CURRENT = 0.5
"""Change of a current with which a push begins [A]."""

UNSEEN = (
    "identification/ur-19_09_27-11_28_22",
    "identification/ur-19_09_27-11_32_02",
    "identification/ur-19_09_27-15_11_06",
    "identification/ur-19_10_01-13_51_41",
    "identification/ur-19_10_01-14_04_13",
    "identification/ur-19_10_01-14_04_41",
    "identification/ur-19_12_23_free",
    "identification/ur-20_01_31-unload",
    "validation/ur-20_01_17-ptp_10_points",
    *(f"validation/ur-20_01_17-p{k}" for k in range(1, 6)),
    *(f"jointwise_motion/ur-20_01_22-joint_{k}" for k in (1, 3, 4, 6)),
)
"""Motion without contact, of other days."""


def _log(name: str) -> str:
    return str(data_folder() / "ur10e" / f"{name}.parquet")


def pushes_in(path: str) -> list[tuple[float, float]]:
    """When joints of the resting robot are displaced [s], by positions alone."""
    log = steelyard.open_log(path)
    names = ["time_s", *(f"q{k}_rad" for k in range(1, 7))]
    table = np.concatenate(list(log.parts(names, (0, None), 1 << 20)))
    t, q = table[:, 0] - table[0, 0], table[:, 1:]
    away = np.flatnonzero((np.abs(q - np.median(q, axis=0)) > DISPLACED).any(axis=1))
    groups = np.split(away, np.flatnonzero(np.diff(t[away]) > 1.0) + 1)
    return [(float(t[k[0]]), float(t[k[-1]])) for k in groups]


def _false_alarms(model: IdentifiedModel) -> Claim:
    found = [steelyard.contact(model, _log(name), rate=RATE) for name in UNSEEN]
    count = sum(len(one.events) for one in found)
    minutes = sum(one.trace.duration for one in found) / 60.0
    return Claim(
        "false alarms on unseen logs of other days, thresholds for one in 10 min",
        f"{count} in {minutes:.1f} min",
        "<= 1 in 10 min",
        count <= max(1.0, minutes / 10.0),
    )


def _first_change(path: str, before: float) -> float:
    """When a current first differs by `CURRENT` from that of the second before [s]."""
    log = steelyard.open_log(path)
    names = ["time_s", *(f"current{k}_A" for k in range(1, 7))]
    table = np.concatenate(list(log.parts(names, (0, None), 1 << 20)))
    t, current = table[:, 0] - table[0, 0], table[:, 1:]
    near = (t > before - 1.0) & (t < before + 1.0)
    usual = np.median(current[(t > before - 2.0) & (t < before - 1.0)], axis=0)
    changed = (np.abs(current[near] - usual) > CURRENT).any(axis=1)
    return float(t[near][np.argmax(changed)])


def _found(model: IdentifiedModel) -> list[Claim]:
    """Pushes, with the time from the first change of a current until the contact is known."""
    path = _log("collision/ur-20_01_22-push_pose_1")
    events = steelyard.contact(model, path, rate=RATE).events
    pushes = pushes_in(path)
    found = [[e for e in events if e.start < stop and e.end > start] for start, stop in pushes]
    beside = [e for e in events if not any(e in one for one in found)]
    delays = [1e3 * (one[0].known - _first_change(path, one[0].start)) for one in found if one]
    loads = [load for one in found if one for load in one[0].joints]
    ratios = [max(load.ratio for load in one[0].joints) for one in found if one]
    for one, delay in zip([one for one in found if one], delays, strict=True):
        clearest = one[0].joints[0]
        size = f"{clearest.peak:+.1f} {clearest.unit}, {clearest.sigmas:.0f} σ"
        print(f"  push at {one[0].start:5.2f} s, known after {delay:3.0f} ms, ", end="")
        print(f"{clearest.joint} {size}, {one[0].place}")
    return [
        Claim(
            "pushes found",
            f"{sum(map(bool, found))} of {len(pushes)}, "
            f"up to {max((load.sigmas for load in loads), default=0.0):.0f} σ",
            "all, no other event",
            all(found) and len(pushes) == 4 and not beside,
        ),
        Claim(
            "least ratio of a push to its threshold",
            f"{min(ratios, default=0.0):.1f}",
            ">= 2",
            all(found) and min(ratios) >= 2.0,
        ),
        Claim(
            f"delay from the first change of a current by {CURRENT:g} A",
            ", ".join(f"{delay:.0f}" for delay in delays) + " ms",
            "<= 1 s: a hand pushes ever harder",
            bool(delays) and max(delays) <= 1000.0,
        ),
    ]


def _soiled(model: IdentifiedModel) -> Claim:
    """Calibration logs, one of which contains the pushes."""
    pushed = _log("collision/ur-20_01_22-push_pose_1")
    free = [_log(name) for name in UNSEEN[6:9]]
    clean = steelyard.contact(model, pushed, calibrate=free, rate=RATE)
    both = steelyard.contact(model, _log(UNSEEN[1]), calibrate=[*free, pushed], rate=RATE)
    suspected = [one for one in both.suspected if "push" in one.run]
    wrong = len(both.suspected) - len(suspected)
    one, other = both.thresholds, clean.thresholds
    tested = np.array(one.own) & np.array(other.own)
    ratios = [*(one.limits / other.limits)[tested], *(one.changes / other.changes)]
    higher = float(max(ratios))
    return Claim(
        "pushes in a calibration log reported and left out",
        f"{len(suspected)} stretches, {wrong} of other logs, thresholds x {higher:.2f} at most",
        ">= 4, 0 of other logs, <= x 1.5",
        len(suspected) >= 4 and not wrong and higher <= 1.5,
    )


def _refused(model: IdentifiedModel, folder: Path) -> list[Claim]:
    """Logs that cannot be compared with thresholds."""
    (run,) = steelyard.load_runs(EXAMPLES / "ur10e.toml", _log(UNSEEN[6]))
    data = run.whole()
    q, gains = data.motion.q, model.signals.gains
    compensated = data.effort - model.gravity(q) / gains
    columns = {"time_s": data.motion.t}
    for name, signal in (
        ("q{}_rad", q),
        ("dq{}_rad_s", data.motion.dq),
        ("current{}_A", compensated),
    ):
        columns |= {name.format(k + 1): x for k, x in enumerate(signal.T)}
    np.savez(folder / "compensated.npz", **columns)
    np.savez(folder / "slow.npz", **{name: x[::2] for name, x in columns.items()})
    return [
        _refusal(model, folder / "compensated.npz", "% of the gravity that the model predicts"),
        _refusal(model, folder / "slow.npz", "less than 10 times the residual's low-pass"),
    ]


def _refusal(model: IdentifiedModel, log: Path, words: str) -> Claim:
    try:
        steelyard.contact(model, log)
    except steelyard.SteelyardError as error:
        said = str(error).splitlines()[0]
        return Claim(f"{log.stem} log refused", said, words, words in said)
    return Claim(f"{log.stem} log refused", "not refused", words, False)


def main() -> list[Claim]:
    """All of the UR10e."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        identified("ur10e", ur10e_logs(), [], output=folder / "model")
        model = steelyard.load_model(folder / "model")
        return [
            _false_alarms(model),
            *_found(model),
            _soiled(model),
            *_refused(model, folder),
        ]


if __name__ == "__main__":
    main_of(main)
