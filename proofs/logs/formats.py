"""One run in every format gives the same clean run, bit for bit.

The files are written by the formats' own reference libraries.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of
from proofs.support.log_files import Table, message_columns, write_messages, write_tables

from steelyard.logs.formats import WRITERS, open_log, writer_for
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import Recording
from steelyard.runs.run import RunData
from steelyard.simulate.simulate import demo_runs


def main() -> list[Claim]:
    """Every format against the CSV file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo_runs(folder / "robot")
        robot = load_robot(folder / "robot" / "demo_arm.toml")
        if robot.signals is None:
            return [Claim("the demo's robot file", "no signals", "signals", False)]
        table = run_of(folder / "robot" / "identification.csv", robot.signals,
                       robot.robot.joint_names)  # fmt: skip
        files = write_tables(folder, table)
        messages = write_messages(folder, table)
        plain = {name: name for name in table.columns}
        found = {label: cleaned(path, robot.signals, plain) for label, path in files.items()}
        topics = message_columns(table)
        found |= {label: cleaned(path, robot.signals, topics) for label, path in messages.items()}
        found |= {
            f"steelyard's own {suffix}": cleaned(
                own(folder / f"own{suffix}", table), robot.signals, plain
            )
            for suffix in WRITERS
        }
    first = found.pop("CSV")
    samples = f"{len(first.t)} samples"
    claims = [Claim("CSV", samples, "a run", len(first.t) > 100)]
    for label, run in found.items():
        faults = differing(first, run)
        figure = f"{samples} alike" if not faults else f"{', '.join(faults)} differ"
        claims.append(Claim(f"{label} against CSV", figure, "bit for bit", not faults))
    return claims


def run_of(path: Path, signals: Signals, joints: tuple[str, ...]) -> Table:
    """A simulated log, its times in whole nanoseconds; velocities are made from positions."""
    frame = pl.read_csv(path)
    q, tau = (frame.select(names).to_numpy() for names in (signals.position, signals.effort))
    seconds = frame[signals.time].to_numpy() * signals.time_scale
    dq = np.gradient(q, seconds, axis=0)
    return Table(joints, 10**18 + np.rint(seconds * 1e9).astype(np.int64), q, dq, tau)


def own(path: Path, table: Table) -> Path:
    """The run as `steelyard log convert` writes it."""
    with writer_for(path)(path, tuple(table.columns)) as write:
        write(np.stack(tuple(table.columns.values()), axis=1))
    return path


def cleaned(path: Path, signals: Signals, names: dict[str, str]) -> RunData:
    """The clean run of a log whose columns have these names."""
    n = len(signals.position)
    q, dq, tau = (tuple(names[f"{s}_{k + 1}"] for k in range(n)) for s in ("q", "dq", "tau"))
    own = replace(signals, time=names["t"], time_scale=1.0, position=q, effort=tau, velocity=dq,
                  velocity_scale=np.ones(n))  # fmt: skip
    return prepare(Recording(open_log(path), own)).whole()


def differing(one: RunData, other: RunData) -> list[str]:
    """Arrays that are not the same, bit for bit."""
    pairs = {
        "t": (one.t, other.t),
        "q": (one.motion.q, other.motion.q),
        "dq": (one.motion.dq, other.motion.dq),
        "ddq": (one.motion.ddq, other.motion.ddq),
        "effort": (one.effort, other.effort),
        "moving": (one.moving, other.moving),
        "segment": (one.segment, other.segment),
    }
    return [name for name, (a, b) in pairs.items() if a.tobytes() != b.tobytes()]


if __name__ == "__main__":
    main_of(main)
