"""Ctrl-C at any time of any command: exit code 130, no traceback, no half-written file."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from proofs.support.claims import Claim, main_of

from steelyard.simulate.simulate import demo_runs

PRESS = Path(__file__).parents[2] / "tests" / "cli" / "interrupted_at.py"

HANGS = 600.0
"""Time after which a command counts as one that does not end [s]; busy machines are slow."""

PLACES = 8
"""Functions per command at which Ctrl-C is pressed, besides those that write."""

MOMENTS = 14
"""Signals per command, spread over its whole duration."""

EARLIEST = 0.06
"""Python itself starts; before that no program can answer a signal [s]."""


def commands(folder: Path) -> dict[str, list[str]]:
    """Every command on simulated logs; `model` is there from an identification before."""
    robot = folder / "robot"
    return {
        "init": ["init", f"{robot}/demo_arm.urdf", f"{robot}/identification.csv"],
        "identify": [
            "identify",
            f"{robot}/demo_arm.toml",
            f"{robot}/identification.csv",
            "--validate",
            f"{robot}/validation.csv",
        ],
        "validate": ["validate", f"{folder}/model", f"{robot}/validation.csv", "-o", "report"],
        "simulate": ["simulate", f"{robot}/demo_arm.toml"],
        "demo": ["demo"],
    }


def start(
    arguments: list[str], place: Path, cache: Path, program: tuple[str, ...] = ("-m", "steelyard")
) -> subprocess.Popen[str]:
    """A command in an empty folder."""
    return subprocess.Popen(
        [sys.executable, *program, *arguments],
        cwd=place,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "STEELYARD_CACHE": str(cache)},
    )


def interrupted(arguments: list[str], delay: float, cache: Path) -> str | None:
    """What was wrong after a signal at `delay` seconds; `None` if all was well."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        process = start(arguments, place, cache)
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        return fault(process, place)


def fault(process: subprocess.Popen[str], place: Path) -> str | None:
    """What is wrong with the end of an interrupted command; `None` if all is well."""
    _, errors = process.communicate(timeout=HANGS)
    left = [path.name for path in place.iterdir()]
    if "Traceback" in errors or "Exception ignored" in errors:
        return f"exit code {process.returncode}: {errors[-300:]}"
    if process.returncode == 0:
        half = [name for name in left if name.startswith(".")]
        return f"finished, but left {half}" if half else None
    if process.returncode != 130:
        return f"exit code {process.returncode}: {errors[-300:]}"
    return f"left {left}" if left else None


def pressed(arguments: list[str], function: str, report: Path, cache: Path) -> str | None:
    """What was wrong after Ctrl-C on entering a function; its functions go to `report`."""
    with tempfile.TemporaryDirectory() as name:
        program = (str(PRESS), function, str(report))
        return fault(start(arguments, Path(name), cache, program), Path(name))


def at_functions(name: str, arguments: list[str], cache: Path, places: int) -> Claim:
    """Interrupt one command where it enters functions: some of all it calls, and all that write."""
    report = cache.with_name(f"functions-{name}")
    faults = [pressed(arguments, "", report, cache)]
    entered = report.read_text().splitlines()
    chosen = entered[:: max(1, len(entered) // places)]
    chosen += [f for f in entered if f.startswith("files.") or ".write_" in f or ".render" in f]
    faults += [
        fault and f"at {function}: {fault}"
        for function in chosen
        for fault in [pressed(arguments, function, report, cache)]
    ]
    wrong = [fault for fault in faults if fault]
    figure = f"{len(faults) - len(wrong)} of {len(faults)} clean" + "".join(
        f"; {f}" for f in wrong[:2]
    )
    return Claim(f"Ctrl-C at functions of {name}", figure, "all", not wrong)


def of_command(name: str, arguments: list[str], cache: Path, moments: int) -> Claim:
    """Interrupt one command at many moments; its first run is cold, so compiling is met too."""
    with tempfile.TemporaryDirectory() as place:
        begin = time.perf_counter()
        start(arguments, Path(place), cache).communicate(timeout=120)
        duration = time.perf_counter() - begin
    delays = [EARLIEST + k * (duration - EARLIEST) / (moments - 1) for k in range(moments)]
    faults = []
    for number, delay in enumerate(delays):
        fresh = cache.with_name(f"{cache.name}-{name}-{number}") if number % 2 else cache
        fault = interrupted(arguments, delay, fresh)
        if fault is not None:
            faults.append(f"at {delay:.2f} s {fault}")
    figure = f"{moments - len(faults)} of {moments} clean" + "".join(f"; {f}" for f in faults[:2])
    return Claim(f"Ctrl-C during {name}, {duration:.1f} s long", figure, "all", not faults)


def main(moments: int = MOMENTS, places: int = PLACES) -> list[Claim]:
    """All commands."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo_runs(folder / "robot")
        cache = folder / "cache"
        identify = [*commands(folder)["identify"], "-o", str(folder / "model")]
        done = start(identify, folder, cache).communicate(timeout=120)
        if not (folder / "model" / "model.json").exists():
            return [Claim("identification before", done[1][-200:], "a model", False)]
        every = commands(folder).items()
        return [
            *(of_command(command, arguments, cache, moments) for command, arguments in every),
            *(at_functions(command, arguments, cache, places) for command, arguments in every),
        ]


if __name__ == "__main__":
    main_of(main)
