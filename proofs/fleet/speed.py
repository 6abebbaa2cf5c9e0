"""Time of a fleet's work: Dask with one and two workers, one new day in thirty, task by task.

Times are ratios of runs side by side, the least of several turns. The start of a cluster of two
workers is left out, and told.
"""

import shutil
import tempfile
import time
from pathlib import Path

import dask
import numpy as np
from distributed import LocalCluster
from proofs.support import simulated_fleet as simulated
from proofs.support.claims import Claim, main_of

import steelyard
from steelyard.base.progress import Event
from steelyard.base.workers import OF_WORKERS, one_thread_each

TIMED = True
ROBOTS, DAYS = 12, 30
OF_DASK = 4  # robots of the runs with and without Dask
TURNS = 4  # the least time of each way counts: a machine is never quite idle
LEAST_EFFICIENCY, MOST_OVERHEAD, MOST_OF_NEW_DAY = 0.85, 0.05, 1.0 / 15.0


class Stopwatch:
    """Times at which logs are done, and of the start of the work."""

    def __init__(self) -> None:
        self.began = 0.0
        self.times: list[float] = []

    def __call__(self, event: Event) -> bool:
        """Take an event of progress."""
        if event.phase == "logs":
            if event.done == 0:
                self.began = time.perf_counter()
            else:
                self.times.append(time.perf_counter())
        return True

    @property
    def each(self) -> float:
        """Time from one log to the next [s]: the slope, as some end together."""
        return float(np.polyfit(np.arange(len(self.times)), self.times, 1)[0])

    @property
    def start(self) -> float:
        """Time until the first log began [s]."""
        return self.times[0] - self.began - self.each


def main() -> list[Claim]:
    with tempfile.TemporaryDirectory() as name:
        folder, few = Path(name), Path(name) / "few"
        few.mkdir()
        simulated.write(simulated.Fleet(OF_DASK, DAYS), few)
        simulated.write(simulated.Fleet(ROBOTS, DAYS), folder)

        def run(folder: Path, store: str, **more: object) -> tuple[Stopwatch, float]:
            watch, began = Stopwatch(), time.perf_counter()
            steelyard.fleet(
                folder / "arm.toml", folder / "logs", temperature="temp", store=folder / store,
                progress=watch, **more,  # type: ignore[arg-type]
            )  # fmt: skip
            return watch, time.perf_counter() - began

        def begun(store: str) -> str:
            shutil.copytree(few / "begun", few / store)
            return store

        steelyard.plan_fleet(few / "arm.toml", few / "logs", temperature="temp",
                             store=few / "begun", processes=1)  # fmt: skip
        one_thread_each()  # of workers that inherit it, as `local:N` does
        quiet = {"n_workers": 1, "dashboard_address": None, "silence_logs": 50}
        found: dict[str, list[Stopwatch]] = {"alone": [], "one": [], "two": [], "pool": []}
        for turn in range(TURNS):
            with (
                dask.config.set(OF_WORKERS),
                LocalCluster(threads_per_worker=1, **quiet) as cluster,
            ):
                way = {"alone": {"processes": 1}, "one": {"cluster": cluster.scheduler_address},
                       "two": {"cluster": "local:2"}, "pool": {"processes": 2}}  # fmt: skip
                for name_of, more in way.items():
                    found[name_of].append(run(few, begun(f"{name_of}{turn}"), **more)[0])
        alone, one, two, pool = (min(found[k], key=lambda w: w.each) for k in found)
        _, whole = run(folder, "whole", processes=2)
        _, again = run(folder, "whole", processes=2)
        simulated.write(simulated.Fleet(ROBOTS, DAYS + 1), folder, range(DAYS, DAYS + 1))
        _, day = run(folder, "whole", processes=2)
        overhead, efficiency = one.each / alone.each - 1.0, one.each / (2.0 * two.each)
    task = one.each - alone.each
    return [
        Claim("Dask, overhead with one worker", f"{overhead:.1%} of {alone.each:.3f} s a log",
              f"<= {MOST_OVERHEAD:.0%}", overhead <= MOST_OVERHEAD),
        Claim("Dask, efficiency with two workers", f"{efficiency:.2f}; start {two.start:.1f} s",
              f">= {LEAST_EFFICIENCY:g}", efficiency >= LEAST_EFFICIENCY),
        Claim("two processes without Dask, for comparison",
              f"efficiency {alone.each / (2.0 * pool.each):.2f}", "reported", True),
        Claim("Dask with 100 workers, by the time per task", f"{max(task, 0.0):.4f} s of the "
              f"scheduler and client for {alone.each:.2f} s of work: at most "
              f"{alone.each / max(task, 1e-9):.0f} workers are busy", "reported", True),
        Claim(f"one new day in {DAYS}", f"{day:.1f} s of {whole:.1f} s, a {whole / day:.1f}th; "
              f"nothing new {again:.1f} s", "<= a 15th", day <= MOST_OF_NEW_DAY * whole),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(main)
