"""`make bench`: speed side by side with a loop over Pinocchio, in one run, on one core.

Seven revolute joints: the Panda of the data folder, or without it an arm of the same kind.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest import mock

if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
for pool in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "POLARS_MAX_THREADS"):
    os.environ[pool] = "1"

import numpy as np  # noqa: E402
import pinocchio as pin  # noqa: E402
from genetic import comparison  # noqa: E402
from linear_searches import comparison as searches  # noqa: E402

from steelyard.estimate.consistent.convex_estimator import Consistent  # noqa: E402
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor  # noqa: E402
from steelyard.estimate.information.filter_and_gram import (  # noqa: E402
    Accumulator,
    ParallelFilter,  # noqa: E402
    Stretch,
    Tiling,
)
from steelyard.estimate.information.gather import accumulate, cut_pieces  # noqa: E402
from steelyard.estimate.information.information import Information, Signature, Window  # noqa: E402
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (  # noqa: E402
    OrdinaryLeastSquares,
    WeightedLeastSquares,
    whitened,
)
from steelyard.estimate.prior.body_priors import (  # noqa: E402
    Knowledge,
    default_knowledge,
)
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous  # noqa: E402
from steelyard.model.laws.laws_without_friction import RigidBody  # noqa: E402
from steelyard.model.model import Model  # noqa: E402
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES  # noqa: E402
from steelyard.runs.run import Block  # noqa: E402
from steelyard.symbolic.native.compiled_programs import TILE_COLUMNS, TILE_ROWS  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from controller_code import controller_code  # noqa: E402
from design import designs  # noqa: E402
from floating_base import floating_rows  # noqa: E402
from observer import observer_rows  # noqa: E402
from quantities import quantities  # noqa: E402
from robots import limbs, seven_joints  # noqa: E402

from cvxpy_oracle import cvxpy_problem, solved  # noqa: E402
from oracles import pinocchio_model  # noqa: E402

ROOT = Path(__file__).parent.parent
Row = tuple[str, str, str, bool]
UNFILTERED = ParallelFilter.design(1.0, 1.0)


def best(work: Callable[[], object], repeats: int = 5) -> float:
    """Least wall time of some repetitions [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def motion(n: int, count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Positions, velocities, accelerations and efforts, joint-major."""
    return tuple(np.random.default_rng(seed).normal(size=(4, n, count)))


def information(
    found: Regressor, data: tuple[np.ndarray, ...], matched: ParallelFilter = UNFILTERED
) -> Information:
    """One window of raw samples."""
    sums = Accumulator(found, matched)(Stretch(*data))
    signature = Signature("bench", found.layout.columns, ("Nm",) * 7, "none")
    return Information(
        found.layout, signature, (Window("run", 0.0, 1.0),),
        sums.grams[None], sums.absolute[None], sums.counts[None],
    )  # fmt: skip


def regressor_rows(found: Regressor) -> list[Row]:
    """The regressor alone: one block of ours against a Python loop over Pinocchio's."""
    count = 256
    q, dq, ddq, effort = motion(7, count)
    rows = np.empty((found.code.n_outputs, count + 8))
    arguments = [
        v for x in (q, dq, ddq, np.empty((0, count)), effort) for v in (x.ctypes.data, count)
    ]
    ours = best(lambda: found.code.raw(count, *arguments, rows.ctypes.data, count + 8), 300) / count
    model = pinocchio_model(found.model.robot)
    data = model.createData()
    samples = [np.ascontiguousarray(x.T) for x in (q, dq, ddq)]

    def loop() -> None:
        for k in range(count):
            pin.computeJointTorqueRegressor(model, data, *(x[k] for x in samples))

    theirs = best(loop, 20) / count
    ratio = theirs / ours
    return [
        ("regressor block, steelyard", f"{1e9 * ours:.0f} ns a sample", "", True),
        ("regressor, Python loop over Pinocchio", f"{1e9 * theirs:.0f} ns a sample", "", True),
        ("regressor: ratio", f"{ratio:.0f}", ">= 30", ratio >= 30.0),
    ]


def cold_rows() -> list[Row]:
    """A robot in memory to machine code of its base regressor, nothing cached."""
    rows: list[Row] = []
    for n, bound in ((7, 0.6), (30, 2.0), (100, 8.0)):
        with (
            tempfile.TemporaryDirectory() as folder,
            mock.patch.dict(os.environ, {"STEELYARD_CACHE": folder}),
        ):
            start = time.process_time()
            base_regressor(Model(limbs(n), (RigidBody(), Coulomb(), Viscous())))
            seconds = time.process_time() - start
        name = f"{n} joints, traced and compiled"
        rows.append((name, f"{seconds:.2f} s", f"<= {bound} s", seconds <= bound))
    return rows


def solution_rows(found: Regressor, count: int) -> list[Row]:
    """Raw samples to solution, the same ones on both sides; theirs is unweighted, so less work.

    Solving takes us some milliseconds for any number of samples: the bound is for long logs.
    """
    data = motion(7, count)
    estimator = WeightedLeastSquares()
    estimator(information(found, data))
    ours = best(lambda: estimator(information(found, data))) / count
    matched = ParallelFilter.design(8.0, 100.0)
    filtered = best(lambda: estimator(information(found, data, matched))) / count
    model = pinocchio_model(found.model.robot)
    state = model.createData()
    q, dq, ddq, effort = (np.ascontiguousarray(x.T) for x in data)
    columns = list(found.base.independent)

    def stored() -> None:
        matrix = np.empty((count * 7, len(columns)))
        for k in range(count):
            rigid = pin.computeJointTorqueRegressor(model, state, q[k], dq[k], ddq[k])
            full = np.hstack([rigid, np.diag(np.sign(dq[k])), np.diag(dq[k])])
            matrix[7 * k : 7 * k + 7] = full[:, columns]
        np.linalg.lstsq(matrix, effort.ravel(), rcond=None)

    theirs = best(stored, 2) / count
    size, ratio = f"{count:.0e} samples".replace("e+0", "e"), theirs / ours
    bound = 50.0 if count >= 100_000 else 0.0
    return [
        (f"{size} to WLS solution, steelyard", f"{1e9 * ours:.0f} ns a sample", "", True),
        ("with parallel filter (8 of 100 Hz)", f"{1e9 * filtered:.0f} ns a sample", "", True),
        ("Pinocchio loop, stored, lstsq", f"{1e9 * theirs:.0f} ns a sample", "", True),
        (
            f"{size} to solution: ratio",
            f"{ratio:.0f}",
            f">= {bound:.0f}" if bound else "",
            ratio >= bound,
        ),
        *(floor_rows(found, ours) if bound else []),
    ]


def floor_rows(found: Regressor, ours: float) -> list[Row]:
    """The arithmetic's own time: operations of kernel and Gram at the machine's best rate."""
    accumulator = Accumulator(found)
    a = np.random.default_rng(0).normal(size=(1500, 1500))
    rate = 2.0 * 1500**3 / best(lambda: a @ a)
    tiles = len(Tiling.of(found.layout).firsts) * TILE_ROWS * TILE_COLUMNS
    operations = found.code.about["n_operations"] + 2 * tiles + accumulator.width
    floor = operations / rate
    return [
        (
            "arithmetic floor (at the rate of BLAS)",
            f"{1e9 * floor:.0f} ns, {100 * floor / ours:.0f} % of the time",
            "",
            True,
        )
    ]


def accuracy_rows(found: Regressor) -> list[Row]:
    """The solution against QR of the stored matrix, at condition 1e4."""
    q, dq, ddq, effort = motion(7, 4000, 3)
    scale = np.ones((7, 1))
    scale[6] = 3e-4
    dense = None
    for power in np.linspace(0.0, 6.0, 61):
        scale[6] = 10.0**-power
        dense = found.dense(q, dq * scale, ddq * scale)
        stacked = dense.reshape(-1, dense.shape[2])
        condition = np.linalg.cond(stacked)
        if condition >= 1e4:
            break
    truth = np.random.default_rng(4).normal(size=dense.shape[2])
    effort = dense @ truth + 0.01 * effort
    orthogonal, triangle = np.linalg.qr(stacked)
    wanted = np.linalg.solve(triangle, orthogonal.T @ effort.ravel())
    states = (q, dq * scale, ddq * scale, effort)
    worst = 0.0
    for size in (1, 100, 1333, 4000):
        for threads in (1, 2):
            values = OrdinaryLeastSquares()(in_parts(found, states, size, threads)).parameters
            error = np.linalg.norm(values.values - wanted) / np.linalg.norm(wanted)
            worst = max(worst, float(error))
    name = f"QR at condition {condition:.0e}, 4 block sizes, 1 and 2 threads"
    return [(name, f"{worst:.1e} relative", "<= 1e-9", worst <= 1e-9)]


def in_parts(
    found: Regressor, data: tuple[np.ndarray, ...], size: int, threads: int
) -> Information:
    """The pass over a run that comes in blocks of `size` samples."""
    count = data[0].shape[1]
    moving = np.ones((7, count), dtype=bool)
    run = Block(0, np.arange(count) / 1000.0, *data, moving)
    blocks = (run.part(start, start + size) for start in range(0, count, size))
    accumulator = Accumulator(found)
    signature = Signature("bench", found.layout.columns, ("Nm",) * 7, "none")
    return accumulate(accumulator, cut_pieces(blocks, "run", accumulator), signature, threads)


def noisy(found: Regressor, known: Knowledge) -> Information:
    """Information of a motion whose efforts have noise; bodies are 1.2 times those known."""
    q, dq, ddq, _ = motion(7, 2000, 5)
    truth = dict.fromkeys(found.base.names, 1.0)
    for body, prior in zip(known.bodies, known.priors, strict=True):
        truth |= zip((f"{n}.{body}" for n in INERTIAL_NAMES), 1.2 * prior.ten, strict=True)
    values = found.base.base_values([truth[name] for name in found.base.names])
    clean = np.einsum("nsp,p->ns", found.dense(q, dq, ddq), values)
    noisy = clean + 0.05 * clean.std(axis=1)[:, None] * motion(7, 2000, 7)[0]
    return information(found, (q, dq, ddq, noisy))


def consistent_rows(found: Regressor) -> list[Row]:
    """The consistent estimate, from information to solution, against the same through CVXPY."""
    known = default_knowledge(found.model)
    data = noisy(found, known)
    consistent = Consistent(found.base, known, gamma=10.0)
    program = consistent.program(whitened(data))
    searching = replace(consistent, gamma=None)

    def through_cvxpy() -> None:
        problem, _ = cvxpy_problem(whitened(data), consistent, 10.0)
        solved(problem, 1e-9)

    ours = best(lambda: consistent.solve(consistent.program(whitened(data)), 10.0))
    theirs = best(through_cvxpy, 3)
    whole = best(lambda: searching(data), 3)
    solves = searching.weighed(whitened(data), program).solves
    ratio = theirs / ours
    return [
        ("consistent, 7 links, information to solution", f"{1e3 * ours:.0f} ms", "", True),
        ("the same through CVXPY", f"{1e3 * theirs:.0f} ms", "", True),
        ("consistent: ratio", f"{ratio:.1f}", ">= 5", ratio >= 5.0),
        (f"consistent, weight searched in {solves} solves", f"{1e3 * whole:.0f} ms", "", True),
    ]


def memory_rows() -> list[Row]:
    """Peak memory of `prepare` and the pass over a Parquet log, 1e7 rows against 1e5."""
    with tempfile.TemporaryDirectory() as folder:
        peaks = []
        for count in (100_000, 10_000_000):
            log = Path(folder) / f"{count}.parquet"
            for task in ("write", "read"):
                done = subprocess.run(
                    [sys.executable, __file__, task, str(log), str(count)],
                    check=True, capture_output=True, text=True,
                )  # fmt: skip
            peaks.append(float(done.stdout.split()[0]))
            seconds = float(done.stdout.split()[1])
            log.unlink()
    more = peaks[1] - peaks[0]
    return [
        ("1e7 rows of Parquet, prepared and gathered", f"{seconds:.0f} s", "", True),
        (
            f"peak memory, 1e5 rows {peaks[0]:.0f} MiB, 1e7 rows {peaks[1]:.0f} MiB",
            f"{more:.0f} MiB more",
            "<= 32 MiB",
            more <= 32.0,
        ),
    ]


def write_log(path: Path, count: int) -> None:
    """A log of seven joints at 1 kHz, row groups of 1e5, written in a process of its own."""
    import polars as pl

    def part(start: int) -> pl.DataFrame:
        t = np.arange(start, start + 100_000) / 1000.0
        columns = {"time_s": t}
        for j in range(7):
            columns[f"q{j + 1}_rad"] = np.sin((0.3 + 0.11 * j) * t + j)
            columns[f"tau{j + 1}_Nm"] = np.cos((0.3 + 0.11 * j) * t)
        return pl.DataFrame(columns)

    parts = (part(start).lazy() for start in range(0, count, 100_000))
    pl.concat(list(parts)).sink_parquet(path, row_group_size=100_000, maintain_order=True)


def read_log(path: Path) -> None:
    """Prepare and gather; prints peak memory [MiB] and seconds."""
    from steelyard.estimate.information.gather import gather
    from steelyard.logs.formats import open_log
    from steelyard.robot.file.signals import Signals
    from steelyard.runs.prepare import prepare
    from steelyard.runs.processing_choices import Processing
    from steelyard.runs.recording import Recording

    model = seven_joints()
    ones = np.ones(7)
    q, tau = (tuple(f"{k}{j}_{u}" for j in range(1, 8)) for k, u in (("q", "rad"), ("tau", "Nm")))
    signals = Signals(
        "time_s", 1.0, q, ones, None, None, tau, ones, "joint_torque", ("Nm",) * 7, ones
    )
    start = time.perf_counter()
    run = prepare(Recording(open_log(path), signals), Processing(20.0, 5.0))
    gather(base_regressor(model), run)
    print(peak_memory(), time.perf_counter() - start)


def peak_memory() -> float:
    """Most memory of this program so far [MiB].

    `ru_maxrss` outlives `exec`: a child begins with its parent's memory. Linux's `VmHWM` does not.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> int:
    """All rows as a table."""
    found = base_regressor(seven_joints())
    rows = [
        *cold_rows(),
        *quantities(best, found.model),
        *controller_code(best, found.model),
        *observer_rows(best, found.model, shutil.which("gcc")),
        *regressor_rows(found),
        *floating_rows(best),
        *solution_rows(found, 5_000),
        *solution_rows(found, 100_000),
        *accuracy_rows(found),
        *consistent_rows(found),
        *comparison(best, range(5)),
        *searches(best, noisy(found, default_knowledge(found.model))),
        *designs(),
        *memory_rows(),
    ]
    for name, figure, bound, holds in rows:
        mark = "" if not bound else ("holds" if holds else "MISSED")
        print(f"{name:<58}  {figure:<34}  {bound:<10}  {mark}".rstrip())
    return 0 if all(row[3] for row in rows) else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["write"]:
        write_log(Path(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1:2] == ["read"]:
        read_log(Path(sys.argv[2]))
    else:
        sys.exit(main())
