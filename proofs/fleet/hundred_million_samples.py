"""10^8 samples of an arm with seven joints on one machine: time and memory beside what they need.

One process works (`local:1`). The parts are made in a temporary folder (16 GB) and removed. Reading
alone and the kernel alone are measured on some of the parts and told for all of them.
`python -m proofs.fleet.hundred_million_samples N` takes N parts of 500 000 samples.
"""

import os
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of
from proofs.support.simulated_fleet import ROBOT_FILE, urdf

import steelyard
from steelyard.base.arrays import Parameters
from steelyard.base.progress import Event
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import start_pass
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

TIMED = True
PARTS, SAMPLES, RATE, MEASURED = 200, 500_000, 1000.0, 6
MOST_MIB, MOST_RATIO, LEAST_COVERED = 600.0, 1.3, 0.9
FRICTION = {"coulomb": 0.8, "viscous": 0.5, "offset": 0.1}
SPREAD_T, NOISE_Q, NOISE_DQ = 0.3, 1e-6, 1e-3  # of efforts [Nm], positions and velocities


def true_parameters(robot_file: Path) -> Parameters:
    """Masses of the URDF, and friction."""
    model = steelyard.model_of(robot_file)
    values = {
        f"{kind}.{body.name}": value
        for body, ten in zip(model.robot.bodies, model.robot.nominal, strict=True)
        for kind, value in zip(INERTIAL_NAMES, ten, strict=True)
    }
    own = [values.get(name, FRICTION.get(name.partition(".")[0], 0.0)) for name in model.names]
    return Parameters(model.names, model.units, np.array(own))


def write_part(folder: Path, number: int) -> None:
    """One part: a motion of five frequencies a joint, of its own phases, with noise."""
    model, rng = steelyard.model_of(folder / "arm.toml"), np.random.default_rng(number)
    robot = model.at(true_parameters(folder / "arm.toml"))
    n, motion = model.robot.n, np.random.default_rng(0)
    w = 2.0 * np.pi * motion.uniform(0.05, 0.6, (n, 5))
    size, phase = motion.uniform(0.1, 0.3, (n, 5)), rng.uniform(0.0, 6.28, (n, 5))
    t = np.arange(SAMPLES) / RATE
    q, dq, ddq = np.zeros((n, SAMPLES)), np.zeros((n, SAMPLES)), np.zeros((n, SAMPLES))
    for k in range(5):
        angle = w[:, k, None] * t + phase[:, k, None]
        wave, slope = size[:, k, None] * np.sin(angle), size[:, k, None] * np.cos(angle)
        q, dq, ddq = q + wave, dq + w[:, k, None] * slope, ddq - w[:, k, None] ** 2 * wave
    tau = np.asarray(robot.torque(steelyard.Motion(t, q.T, dq.T, ddq.T))).T
    columns = {"t": t + number * SAMPLES / RATE}
    for name, x, noise in (("q", q, NOISE_Q), ("dq", dq, NOISE_DQ), ("tau", tau, SPREAD_T)):
        columns |= {f"{name}{j + 1}": x[j] + rng.normal(0.0, noise, SAMPLES) for j in range(n)}
    pl.DataFrame(columns).write_parquet(folder / "logs" / f"part{number:03d}.parquet")


class Memory:
    """Memory of this process and all below it, what they share counted once [MiB]."""

    def __init__(self) -> None:
        self.before, self.most = self._now(), 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._ended.wait(0.25):
            self.most = max(self.most, self._now())

    def end(self) -> float:
        """Stop; the largest sum that was seen."""
        self._ended.set()
        self._thread.join()
        return self.most

    def _now(self) -> float:
        parents = {}
        for status in Path("/proc").glob("[0-9]*/stat"):
            try:
                words = status.read_text().rpartition(")")[2].split()
                parents[int(status.parent.name)] = int(words[1])
            except OSError:
                continue
        mine, more = set[int](), {os.getpid()}
        while more:
            mine |= more
            more = {child for child, parent in parents.items() if parent in more}
        total = 0
        for process in mine:
            try:
                lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
            except OSError:
                continue
            total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        return total / 1024.0


def floors(model: steelyard.IdentifiedModel, logs: list[Path]) -> tuple[float, float]:
    """Time of reading a part, and of its sums of products in the kernel [s]."""
    regressor, reading, kernel = base_regressor(model.model), 0.0, 0.0
    for log in logs:
        began = time.perf_counter()
        pl.read_parquet(log, columns=list(model.signals.columns)).to_numpy()
        reading += time.perf_counter() - began
        (run,) = steelyard.load_runs(log.parent.parent / "arm.toml", log)
        accumulator, pieces, _ = start_pass(regressor, run, rests=False)
        kept = list(pieces)
        began = time.perf_counter()
        for _, stretch in kept:
            accumulator(stretch)
        kernel += time.perf_counter() - began
    return reading / len(logs), kernel / len(logs)


class Watch:
    """Time in which workers make parts."""

    def __init__(self) -> None:
        self.began = self.ended = 0.0

    def __call__(self, event: Event) -> bool:
        """Take an event of progress."""
        if event.phase == "logs":
            self.began = self.began or time.perf_counter()
            self.ended = time.perf_counter()
        return True


def main() -> list[Claim]:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else PARTS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "logs").mkdir()
        os.environ["STEELYARD_CACHE"] = str(folder / "cache")
        (folder / "arm.toml").write_text(ROBOT_FILE.format(urdf=urdf()))
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            for number, _ in enumerate(pool.map(write_part, [folder] * count, range(count))):
                print(f"\rwritten: {number + 1} of {count}", end="", file=sys.stderr)
        memory, watch, began = Memory(), Watch(), time.perf_counter()
        found = steelyard.identify(
            folder / "arm.toml", folder / "logs", cluster="local:1", progress=watch
        )
        whole, most = time.perf_counter() - began, memory.end()
        logs = sorted((folder / "logs").glob("*"))
        reading, kernel = floors(found.model, logs[:: max(1, count // MEASURED)])
        estimate, true = found.model.estimate, true_parameters(folder / "arm.toml").as_dict()
        standard = [true.get(name, 0.0) for name in found.model.base.names]
        base = found.model.base.base_values(standard)
    off = np.abs(estimate.parameters.values - base)
    covered = float(np.mean(off <= estimate.half_width))
    floor = (reading + kernel) * count
    made = watch.ended - watch.began
    return [
        Claim("samples", f"{count * SAMPLES:.3g} in {count} parts, {whole:.0f} s in all; "
              f"{made:.0f} s for the sums of all parts, {whole - made:.0f} s for the first model, "
              "hashes and the report", "reported", True),
        Claim("time of all sums over reading alone and the kernel alone",
              f"{made / floor:.2f} ({reading:.2f} s and {kernel:.2f} s a part)",
              f"<= {MOST_RATIO}", made <= MOST_RATIO * floor),
        Claim("memory", f"{most:.0f} MiB, {memory.before:.0f} MiB of it before",
              f"<= {MOST_MIB:.0f} MiB", most <= MOST_MIB),
        Claim("base parameters in their 95 % intervals", f"{covered:.1%} of {len(off)}; relative "
              f"error {np.linalg.norm(off) / np.linalg.norm(base):.1e}",
              f">= {LEAST_COVERED:.0%}", covered >= LEAST_COVERED),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(main)
