"""A Parquet folder of ten million rows: identified in constant memory, with progress, stoppable."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of

from steelyard.simulate.simulate import demo_runs

TIMED = True  # nothing else may run beside it

ROWS = 10_000_000
SMALL = 1_000_000
MORE = 64.0
"""Memory that ten times the rows may take beyond [MiB]."""
PER_FILE = 500_000
EVENTS = 50
"""Events of progress that are wanted of the pass over the data."""

IDENTIFY = """
import sys
from pathlib import Path
from steelyard.identify.identify import identify

events, fitted = {}, 0.0

def peak():
    status = Path("/proc/self/status").read_text()
    return float(status.partition("VmHWM:")[2].split()[0]) / 1024.0

def watch(event):
    global fitted
    if event.phase == "validating" and not fitted:
        fitted = peak()
    events.setdefault(event.phase, []).append(event.done / max(event.total, 1e-9))
    return True

identify(sys.argv[1], sys.argv[2], threads=2, progress=watch).save(sys.argv[3])
# every pass over the data begins anew
rising = all(a <= b or b < 0.05 for done in events.values() for a, b in zip(done, done[1:]))
print("RESULT", fitted, peak(), max(map(len, events.values())), rising)
"""


def main() -> list[Claim]:
    """Identify from a small folder and a large one, convert, and press Ctrl-C."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo_runs(folder / "robot")
        small, large = (write(folder, rows) for rows in (SMALL, ROWS))
        peaks: list[tuple[float, float]] = []
        for log in (small, large):
            start = time.perf_counter()
            fitted, peak, events, rising = identified(folder, log)
            peaks.append((fitted, peak))
            seconds = time.perf_counter() - start
        return [
            *(grown(what, *pair, seconds) for what, pair in zip(
                ("checked, gathered and fitted", "scored too, the whole command"),
                zip(*peaks, strict=True), strict=True)),
            Claim("identify: events of progress", f"{events}, rising: {rising}",
                  f">= {EVENTS}, rising", events >= EVENTS and rising),
            *(stopped(folder, large, delay) for delay in (2.0, 6.0, 15.0)),
            *(converted(folder, large, suffix) for suffix in (".csv", ".parquet", ".npz", ".h5")),
        ]  # fmt: skip


def grown(what: str, small: float, large: float, seconds: float) -> Claim:
    """Peak memory of ten times the rows [MiB]."""
    figure = f"{small:.0f} -> {large:.0f} MiB, {seconds:.0f} s"
    return Claim(f"memory, 1e6 -> 1e7 rows: {what}", figure, f"+{MORE:.0f} MiB",
                 large - small <= MORE)  # fmt: skip


def write(folder: Path, rows: int) -> Path:
    """The demo arm's run, played again and again, in files of a folder by days."""
    target = folder / f"rows{rows}"
    run = pl.read_csv(folder / "robot" / "identification.csv")
    period = float(run["time_s"][-1]) + float(run["time_s"].diff().median())  # type: ignore[arg-type]
    again = PER_FILE // len(run) + 1
    start = 0.0
    for number in range(rows // PER_FILE):
        turns = np.repeat(np.arange(again), len(run)) * period
        part = pl.concat([run] * again).with_columns(pl.col("time_s") + pl.Series(turns) + start)[
            :PER_FILE
        ]
        start = float(part["time_s"][-1]) + float(run["time_s"].diff().median())  # type: ignore[arg-type]
        day = target / f"day={number // 8 + 1}"
        day.mkdir(parents=True, exist_ok=True)
        part.write_parquet(day / f"part-{number}.parquet", row_group_size=100_000)
    return target


def identified(folder: Path, log: Path) -> tuple[float, float, int, bool]:
    """Peaks before scores and of all [MiB], events of the longest phase, whether they rise."""
    out = folder / f"out-{log.name}"
    robot = folder / "robot" / "demo_arm.toml"
    done = subprocess.run(
        [sys.executable, "-c", IDENTIFY, str(robot), str(log), str(out)],
        capture_output=True,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    found = re.search(r"RESULT (\S+) (\S+) (\d+) (\w+)", done.stdout)
    if found is None or not (out / "model.json").exists():
        raise RuntimeError(done.stderr[-500:])
    return float(found[1]), float(found[2]), int(found[3]), found[4] == "True"


def stopped(folder: Path, log: Path, delay: float) -> Claim:
    """Ctrl-C while a command works on the folder."""
    faults = []
    robot = str(folder / "robot" / "demo_arm.toml")
    for name, arguments in {
        "identify": ["identify", robot, str(log)],
        "convert": ["log", "convert", str(log), "out.csv"],
    }.items():
        with tempfile.TemporaryDirectory() as place:
            child = subprocess.Popen(
                [sys.executable, "-m", "steelyard", *arguments],
                cwd=place,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            time.sleep(delay)
            child.send_signal(signal.SIGINT)
            begin = time.perf_counter()
            _, errors = child.communicate(timeout=60)
            waited = time.perf_counter() - begin
            left = [path.name for path in Path(place).iterdir()]
            whole = child.returncode == 0 and left == ["out.csv"]
            if not whole and (child.returncode != 130 or left or "Traceback" in errors):
                faults.append(f"{name}: exit {child.returncode}, left {left}, {errors[-200:]}")
            if waited > 5.0:
                faults.append(f"{name} went on for {waited:.0f} s")
    figure = "; ".join(faults) or "exit 130, nothing left"
    return Claim(f"Ctrl-C after {delay:.0f} s", figure, "no half-written file", not faults)


def converted(folder: Path, log: Path, suffix: str) -> Claim:
    """Two million rows in another format: memory of the process that writes them."""
    output = folder / f"converted{suffix}"
    code = (
        "import sys; from steelyard.cli.app import app\n"
        "try: app(sys.argv[1:])\n"
        "except SystemExit as end: assert not end.code\n"
        "print('RESULT', open('/proc/self/status').read().partition('VmHWM:')[2].split()[0])"
    )
    arguments = ["log", "convert", f"{log}#0:2000000", str(output)]
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    found = re.search(r"RESULT (\d+)", done.stdout)
    peak = float(found[1]) / 1024.0 if found else float("inf")
    output.unlink(missing_ok=True)
    return Claim(f"convert 2e6 rows to {suffix}: memory", f"{peak:.0f} MiB", "<= 256 MiB",
                 peak <= 256.0)  # fmt: skip


if __name__ == "__main__":
    main_of(main)
