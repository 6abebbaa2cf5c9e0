"""Two mistakes in one job: corrected, or reported as not distinguishable, and never made worse.

Ten kinds of pairs in logs of a simulated arm, every draw another arm with hidden masses, friction
and motion; the model file is off by up to 10 % per parameter, as model files are. A draw is right
if the model identified with the lines that `check --fix` writes is within 3 % of the truth; if
they bring it nearer, and both mistakes are named, as wrong or as open; or if no line is written
and the output names both, or that something is wrong and what cannot be distinguished. `--draws N`
and `--only NAME` as they say.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.mistake_outcome import Outcome, outcome_of
from proofs.support.mistakes import Arm, Job, Log
from proofs.support.mistakes_of_robots import carrying, gravity, zero_offset
from proofs.support.mistakes_planted import late, scaled

CLEAN = 3.0
"""True error [%] up to which a job counts as put right."""

WORSE = 1.1
"""Factor by which lines that are written may raise the true error, above `CLEAN`."""

DRAWS = 4
LOADED = 2.0
RIGHT = 0.95


@dataclass(frozen=True)
class Pair:
    """Two mistakes.

    Attributes:
        name: What they are.
        plant: Makes the job.
        says: One pattern per mistake, of a sentence that names it.
        load: What the arm carries in all logs, and so in truth [kg].
    """

    name: str
    plant: Callable[[Arm], Job]
    says: tuple[str, str]
    load: float = 0.0


def also(first: Callable[[Arm], Job], change: Callable[[Arm, Log], Log]) -> Callable[[Arm], Job]:
    """Another mistake in all logs of a job."""
    return lambda arm: first(arm).every(lambda log: change(arm, log))


def turned(arm: Arm, log: Log) -> Log:
    """All efforts with the other sign."""
    return replace(log, tau=-log.tau)


def one_turned(arm: Arm, log: Log) -> Log:
    """The efforts of one joint with the other sign."""
    signs = np.ones(arm.robot.n)
    signs[arm.joint(1)] = -1.0
    return replace(log, tau=log.tau * signs)


def times(factor: float) -> Callable[[Arm, Log], Log]:
    """All efforts times a factor."""
    return lambda arm, log: replace(log, tau=log.tau * factor)


def one_times(factor: float, joint: int = 0) -> Callable[[Arm, Log], Log]:
    """The efforts of one joint times a factor."""

    def change(arm: Arm, log: Log) -> Log:
        factors = np.ones(arm.robot.n)
        factors[arm.joint(joint)] = factor
        return replace(log, tau=log.tau * factors)

    return change


def swapped(arm: Arm, log: Log) -> Log:
    """Efforts of two joints in each other's column."""
    order = list(range(arm.robot.n))
    a, b = arm.joint(0), arm.joint(1)
    order[a], order[b] = order[b], order[a]
    return replace(log, tau=log.tau[:, order])


def degrees(arm: Arm, log: Log) -> Log:
    """Positions and velocities in degrees."""
    dq = None if log.dq is None else np.rad2deg(log.dq)
    return replace(log, q=np.rad2deg(log.q), dq=dq)


SIGN = r"check (wrong|doubtful|open) effort sign"
UNIT = r"check (wrong|doubtful|open) effort unit"
ORDER = r"check (wrong|doubtful|open) joint order"
GAIN = r"check (wrong|doubtful|open) gain|scale of the efforts"
LOAD = r"payload|carries|load"
MOUNT = r"check (wrong|doubtful|open) mounting"
POSITION = r"check (wrong|doubtful|open) position unit|in degrees|deg"
LATE = r"late|delay"
ZERO = r"zero offset"
WALL = "[9.81, 0.0, 0.0]"

PAIRS = (
    Pair(
        "sign of all and a payload",
        also(carrying(LOADED, 0, 1, 2), turned),
        (SIGN, LOAD),
        LOADED,
    ),
    Pair(
        "sign of one and a payload",
        also(carrying(LOADED, 0, 1, 2), one_turned),
        (SIGN, LOAD),
        LOADED,
    ),
    Pair("order and unit", also(scaled("tau", 1000.0), swapped), (ORDER, UNIT)),
    Pair(
        "order and sign of one",
        also(scaled("tau", 1.0), lambda arm, log: one_turned(arm, swapped(arm, log))),
        (ORDER, SIGN),
    ),
    Pair("mounting and sign of all", also(gravity(WALL), turned), (MOUNT, SIGN)),
    Pair("mounting and a gain of 2", also(gravity(WALL), one_times(2.0)), (MOUNT, GAIN)),
    Pair("mounting and unit", also(gravity("[0.0, -9.81, 0.0]"), times(1000.0)), (MOUNT, UNIT)),
    Pair("unit and positions in degrees", also(scaled("tau", 1000.0), degrees), (UNIT, POSITION)),
    Pair("sign of all and efforts 40 ms late", also(late(0.04, "tau"), turned), (SIGN, LATE)),
    Pair(
        "a zero off by 0.2 and a gain of 2",
        also(zero_offset((2, 0.2)), one_times(2.0, 1)),
        (ZERO, GAIN),
    ),
)


def one(task: tuple[str, int]) -> Outcome:
    """What comes of one draw."""
    name, seed = task
    pair = next(p for p in PAIRS if p.name == name)
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)
        (there / "arm").mkdir()
        arm = Arm.drawn(seed, there / "arm")
        try:
            job = pair.plant(arm)
            real = replace(arm, truth=arm.loaded(pair.load)) if pair.load else arm
            return outcome_of(real, job, there / "job", validated=False)
        except Exception as error:
            return Outcome((f"crash: {type(error).__name__}: {error}",), None)


def right(pair: Pair, found: Outcome) -> bool:
    """Whether a draw is put right, or rightly left to the user."""
    if any(line.startswith("crash") for line in found.sentences):
        return False
    if found.error is not None and found.error <= CLEAN:
        return True
    named = all(any(re.search(says, line) for line in found.sentences) for says in pair.says)
    if found.fix is not None:
        return found.fix[1] <= CLEAN or (found.fix[1] < found.fix[0] and named)
    untold = bool(found.wrong) and any("cannot distinguish" in line for line in found.sentences)
    return named or untold


def worse(found: Outcome) -> bool:
    """Whether lines that were written lead further from the truth."""
    return found.fix is not None and found.fix[1] > max(WORSE * found.fix[0], CLEAN)


def line_of(pair: Pair, seed: int, found: Outcome) -> str:
    """One row of the table."""
    verdict = "WORSE" if worse(found) else "right" if right(pair, found) else "MISSED"
    error = "refused" if found.error is None else f"{found.error:.2g} %"
    fix = "no fix" if found.fix is None else f"fix {found.fix[0]:.2g} -> {found.fix[1]:.2g} %"
    return f"{verdict:<7}{pair.name:<36}{seed:>4}  {error}, {fix}"


def main(pairs: Sequence[Pair] = PAIRS, draws: int = DRAWS) -> list[Claim]:
    """All draws, on two processes."""
    tasks = [(pair.name, seed) for seed in range(1, draws + 1) for pair in pairs]
    byname = {pair.name: pair for pair in pairs}
    good, bad, whole = dict.fromkeys(byname, 0), [], 0
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for (name, seed), found in zip(tasks, pool.map(one, tasks), strict=True):
            print(line_of(byname[name], seed, found), file=sys.stderr, flush=True)
            good[name] += right(byname[name], found) and not worse(found)
            bad += [f"{name} ({seed})"] * worse(found)
            whole += found.fix is not None and found.fix[1] <= CLEAN
    total = sum(good.values())
    listed = ", ".join(f"{name} {count}" for name, count in good.items())
    return [
        Claim(
            f"pairs of mistakes, {draws} draws each, put right or rightly left open",
            f"{total} of {len(tasks)}, {whole} of them put right by --fix ({listed})",
            f">= {100.0 * RIGHT:g} %",
            total >= RIGHT * len(tasks),
        ),
        Claim("wrong fixes", f"{len(bad)} {', '.join(bad)}", "none", not bad),
    ]


def requested() -> list[Claim]:
    """As the command line asks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--draws", type=int, default=DRAWS)
    parser.add_argument("--seed", type=int, default=0, help="one draw, with all sentences")
    options = parser.parse_args()
    chosen = [pair for pair in PAIRS if options.only in pair.name]
    if options.seed:
        for pair in chosen:
            found = one((pair.name, options.seed))
            print(line_of(pair, options.seed, found), *found.sentences, *found.changes, sep="\n  ")
        sys.exit()
    return main(chosen, options.draws)


if __name__ == "__main__":
    main_of(requested)
