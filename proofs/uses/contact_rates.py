"""False alarms of contact, stated and counted, on motion of simulated arms without any contact.

Arms of 3 to 7 joints with invented bodies and friction are simulated by Pinocchio at 100 Hz: point
to point with rests, friction that holds anywhere in its dead zone at rest, and coloured noise of
the efforts. A model is identified from four logs of 90 s, thresholds are calibrated on ten logs of
five minutes of the same process, and on the model's own left-out motion alone. The stated rate is
an upper bound: it is kept if so many alarms are not significantly more than it (Poisson, 95 %).

Run by itself it takes the number of arms and the hours of each:
`python -m proofs.uses.contact_rates 4 2`.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from proofs.support.claims import Claim, table
from scipy.signal import lfilter
from scipy.stats import poisson

import steelyard
from steelyard.base.arrays import Array
from steelyard.base.progress import silent
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    ResidualTrace,
    residual_trace,
    thresholds_of,
)
from steelyard.identify.runs_and_notes_of_logs import runs_for
from steelyard.logs.formats import write_table
from steelyard.runs.runs_of_named_logs import log_files
from steelyard.uses.contact.contact import common_rest_speed, contacts_in, peaks_of_free_motion

ARMS, HOURS = 10, 4
STATED = (0.2, 1.0, 6.0)
"""False alarms per hour that are asked for."""
HZ = 100.0
FITTED, CALIBRATED = (4, 90.0), (10, 300.0)
"""Number and length of logs [s]."""
SHORT, EVERY = 25.0, 450.0
"""Pieces of a log that are judged alone, and from one to the next [s]."""
LEAST_KEPT = 0.95
"""Share of the arms whose stated rates are kept."""


class Arm:
    """A serial arm, its URDF with nominal bodies, and the truth."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.n = n = int(rng.integers(3, 8))
        axes = rng.choice(["0 0 1", "0 1 0", "1 0 0"], n)
        axes[:2] = "0 0 1", "0 1 0"
        length = rng.uniform(0.1, 0.4, n)
        mass = rng.uniform(6.0, 12.0) * np.geomspace(1.0, 0.1, n) * rng.uniform(0.7, 1.3, n)
        self.limit = 60.0 * np.cumsum((mass * length)[::-1])[::-1]
        parts = ['<robot name="arm"><link name="base"/>']
        for k in range(n):
            inertia = mass[k] * np.array([length[k] ** 2, length[k] ** 2, 0.01]) / 8.0
            parts.append(
                f'<link name="l{k}"><inertial><origin xyz="0 0 {length[k] / 2}"/>'
                f'<mass value="{mass[k]}"/><inertia ixx="{inertia[0]}" iyy="{inertia[1]}" '
                f'izz="{inertia[2]}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
                f'<joint name="j{k}" type="revolute">'
                f'<parent link="{f"l{k - 1}" if k else "base"}"/>'
                f'<child link="l{k}"/><origin xyz="0 0 {length[k - 1] if k else 0.2}"/>'
                f'<axis xyz="{axes[k]}"/><limit lower="-2.6" upper="2.6" velocity="2.5" '
                f'effort="{self.limit[k]}"/></joint>'
            )
        self.urdf = "".join([*parts, "</robot>"])
        self.model = pin.buildModelFromXML(self.urdf)
        for k in range(1, n + 1):
            known = self.model.inertias[k]
            turned = pin.exp3(0.2 * rng.standard_normal(3))
            scale = np.exp(0.2 * rng.standard_normal())
            self.model.inertias[k] = pin.Inertia(
                known.mass * scale,
                known.lever + 0.01 * rng.standard_normal(3),
                scale * turned @ known.inertia @ turned.T,
            )
        typical = 0.3 * self.limit
        self.noise = 0.008 * 0.5 * typical
        spread = np.exp(0.3 * rng.standard_normal((3, n)))
        self.coulomb, self.viscous, self.rotor = (
            typical * s * row for s, row in zip((0.05, 0.05, 0.02), spread, strict=True)
        )
        self.load = rng.uniform(0.0, 0.03, n)
        """Friction that depends on the load and is in no fitted term."""

    def move(self, seed: int, seconds: float) -> dict[str, Array]:
        """A log of point-to-point motion with rests."""
        rng = np.random.default_rng([seed, 7])
        q, dq, ddq = (np.zeros((int(seconds * HZ), self.n)) for _ in range(3))
        at, here = 0, rng.uniform(-2.3, 2.3, self.n)
        while at < len(q):
            rest = int(rng.uniform(0.0, 2.0) * HZ)
            q[at : at + rest] = here
            at += rest
            there = rng.uniform(-2.3, 2.3, self.n)
            lasts = max(0.3, float(np.max(1.875 * np.abs(there - here))) / rng.uniform(0.7, 2.5))
            s = (np.arange(int(lasts * HZ)) / (lasts * HZ))[: max(len(q) - at, 0), None]
            way = there - here
            part = slice(at, at + len(s))
            q[part] = here + way * (s**3 * (10 - 15 * s + 6 * s**2))
            dq[part] = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / lasts
            ddq[part] = way * (60 * s - 180 * s**2 + 120 * s**3) / lasts**2
            at, here = at + len(s), there
        data = self.model.createData()
        rigid = np.array([pin.rnea(self.model, data, *now) for now in zip(q, dq, ddq, strict=True)])
        friction = (self.coulomb + self.load * np.abs(rigid)) * np.tanh(dq / 0.01)
        still = np.abs(dq) < 1e-9
        begins = np.cumsum(np.diff(still, axis=0, prepend=False) & still, axis=0)
        held = rng.uniform(-0.7, 0.7, (begins.max() + 1, self.n))
        held = np.take_along_axis(held, begins, axis=0) * self.coulomb
        friction = np.where(still, held, friction) + self.viscous * dq
        keep = np.exp(-1.0 / (0.3 * HZ))
        white = rng.standard_normal((2, *q.shape))
        slow = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white[1], axis=0)
        efforts = rigid + friction + self.rotor * ddq + self.noise * (white[0] + 1.5 * slow)
        position = np.round(q / 2e-5) * 2e-5
        columns = {"time_s": np.arange(len(q)) / HZ}
        columns |= {f"q{k + 1}": position[:, k] for k in range(self.n)}
        return columns | {f"tau{k + 1}": efforts[:, k] for k in range(self.n)}


def counts(seed: int, hours: int, folder: Path) -> dict[str, list[tuple[float, float, int]]]:
    """By calibration, the stated rates with hours that were judged and alarms."""
    arm = Arm(seed)
    (folder / "arm.urdf").write_text(arm.urdf)

    def log(name: str, number: int, seconds: float) -> str:
        write_table(folder / f"{name}.parquet", arm.move(1000 * seed + number, seconds))
        return str(folder / f"{name}.parquet")

    fitted = [log(f"fit{k}", k, FITTED[1]) for k in range(FITTED[0])]
    model = steelyard.identify(str(folder / "arm.urdf"), fitted, check=False).model
    free = [log(f"free{k}", 100 + k, CALIBRATED[1]) for k in range(CALIBRATED[0])]
    assert model.calibration is not None and (own := model.calibration.peaks) is not None
    rest, sigma = common_rest_speed(model, ()), np.asarray(model.estimate.sigma)

    def traces(paths: list[str]) -> list[ResidualTrace]:
        """As `contact` makes them; thresholds and traces are the same for all hours."""
        runs = runs_for(model, log_files(paths), silent, at_rest=True)
        return [residual_trace(model, replace(x, rest_speed=rest), own.cutoff) for x in runs]

    def alarms(trace: ResidualTrace, thresholds: ContactThresholds) -> int:
        return len(contacts_in(trace, thresholds, model.robot, sigma))

    peaks, _ = peaks_of_free_motion(model, traces(free), rest, own.cutoff, own)
    levels = {("calibrated", rate): thresholds_of(model, peaks, rate) for rate in STATED}
    alone = thresholds_of(model, own, None)
    levels["own", alone.rate] = alone
    found: dict[str, list[tuple[float, float, int]]] = {}
    for hour in range(hours):
        path = log("hour", 200 + hour, 3600.0)
        (trace,) = traces([path])
        for (kind, rate), one in levels.items():
            found.setdefault(kind, []).append((rate, 1.0, alarms(trace, one)))
    pieces = [
        f"{path}@{start:g}:{start + SHORT:g}" for start in np.arange(0.0, 3600.0 - SHORT, EVERY)
    ]
    for piece in pieces:
        (trace,) = traces([piece])
        count = alarms(trace, levels["calibrated", STATED[-1]])
        found.setdefault("short", []).append((STATED[-1], SHORT / 3600.0, count))
    public = steelyard.contact(model, pieces[-1], calibrate=free, rate=STATED[-1])
    assert len(public.events) == count
    np.testing.assert_allclose(
        public.thresholds.at(trace.ranges(own.edges)),
        levels["calibrated", STATED[-1]].at(trace.ranges(own.edges)),
    )
    return found


def main(arms: int = ARMS, hours: int = HOURS) -> list[Claim]:
    """The claims."""
    kept: dict[str, list[bool]] = {}
    totals: dict[str, list[float]] = {}
    for seed in range(1, arms + 1):
        with tempfile.TemporaryDirectory() as folder:
            for kind, rows in counts(seed, hours, Path(folder)).items():
                for rate in sorted({row[0] for row in rows}):
                    spans = [row[1:] for row in rows if row[0] == rate]
                    spent, alarms = sum(s for s, _ in spans), sum(a for _, a in spans)
                    name = kind if kind == "own" else f"{kind}, {rate:g} per hour stated"
                    bound = float(poisson.ppf(0.95, rate * spent))
                    kept.setdefault(name, []).append(alarms <= bound)
                    sums = totals.setdefault(name, [0.0, 0.0, 0.0])
                    totals[name] = [
                        a + b for a, b in zip(sums, (rate * spent, spent, alarms), strict=True)
                    ]
                    print(f"  arm {seed}: {name}: {alarms} in {spent:.2f} h, stated {rate:.3g}/h")
    claims = []
    for name, judged in kept.items():
        expected, spent, alarms = totals[name]
        claims.append(
            Claim(
                f"{name}: stated rate kept, of {len(judged)} arms",
                f"{np.mean(judged):.0%}; {alarms:.0f} alarms in {spent:.1f} h, "
                f"{expected:.1f} stated",
                f">= {LEAST_KEPT:.0%}",
                bool(np.mean(judged) >= LEAST_KEPT),
            )
        )
    return claims


if __name__ == "__main__":
    print(table(main(*map(int, sys.argv[1:3]))))
