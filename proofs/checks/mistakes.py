"""Mistakes that are planted in a job: each is reported, and no fix that is written makes it worse.

A simulated arm, two logs fitted and one validated, one mistake each. A mistake is right if the
expected sentence is there, and `check` calls nothing else wrong; or if it was handled, so
that the true error stays small. Clean jobs are right if nothing is found wrong.
`--only NAME` runs those whose names contain it and prints all sentences; `--seed N` takes
another arm.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from proofs.support.claims import Claim, main_of
from proofs.support.mistake_outcome import Outcome, outcome_of
from proofs.support.mistakes import Arm, Mistake
from proofs.support.mistakes_of_logs import LOGS
from proofs.support.mistakes_of_robots import ROBOTS

MISTAKES = [*LOGS, *ROBOTS]
SEED = 1
UNTOLD = 5
"""Mistakes at most that cannot be detected from logs."""

CLEAN = 3.0
"""True error [%] up to which a clean job was identified."""

WORSE = 1.1
"""Factor up to which the true error of a model identified with a fix may exceed that without."""


def one(task: tuple[str, int]) -> Outcome:
    """What comes of one mistake."""
    name, seed = task
    mistake = next(m for m in MISTAKES if m.name == name)
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)
        (there / "arm").mkdir()
        arm = Arm.drawn(seed, there / "arm")
        job = mistake.plant(arm)
        try:
            return outcome_of(arm, job, there / "job", validated="validate" in mistake.says)
        except Exception as error:
            return Outcome((f"crash: {type(error).__name__}: {error}",), None)


def right(mistake: Mistake, found: Outcome) -> bool:
    """Whether the expected sentence is there, and nothing else is called wrong."""
    if not mistake.says and not mistake.untold:
        quiet = not any(
            re.match("check wrong|refusal|headline (fair|poor)", s) for s in found.sentences
        )
        return quiet and found.error is not None and found.error <= CLEAN
    if any(line.startswith("crash") for line in found.sentences):
        return False
    handled = found.error is not None and found.error <= mistake.error
    named = bool(mistake.says) and any(re.search(mistake.says, line) for line in found.sentences)
    allowed = re.compile("|".join(p for p in (mistake.says, mistake.beside) if p) or "$^")
    return (named or handled) and all(allowed.search(line) for line in found.wrong)


def worse(found: Outcome) -> bool:
    """Whether a written fix leads to a model further from the truth than no fix."""
    return found.fix is not None and found.fix[1] > max(WORSE * found.fix[0], CLEAN)


def line_of(mistake: Mistake, found: Outcome) -> str:
    """One row of the table."""
    verdict = "right" if right(mistake, found) else "untold" if mistake.untold else "WRONG"
    error = "refused" if found.error is None else f"{found.error:.2g} %"
    fix = "" if found.fix is None else f", fix {found.fix[0]:.2g} -> {found.fix[1]:.2g} %"
    others = [s for s in found.sentences if not s.startswith("note: ")]
    hit = [s for s in found.sentences if mistake.says and re.search(mistake.says, s)]
    first = (hit or others or [""])[0].replace("\n", " ")[:110]
    return f"{verdict:<7}{mistake.name:<36}{error + fix:<32}{first}"


def outcomes(mistakes: Sequence[Mistake], seed: int) -> list[Outcome]:
    """All of them, on two processes; a row of the table as each comes."""
    tasks = [(mistake.name, seed) for mistake in mistakes]
    found = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for mistake, outcome in zip(mistakes, pool.map(one, tasks), strict=True):
            found.append(outcome)
            print(line_of(mistake, outcome), file=sys.stderr, flush=True)
    return found


def main(mistakes: Sequence[Mistake] = MISTAKES, seed: int = SEED) -> list[Claim]:
    """Run all, print the table, claim."""
    found = outcomes(mistakes, seed)
    pairs = list(zip(mistakes, found, strict=True))
    missed = [m.name for m, o in pairs if not right(m, o)]
    excused = [m.name for m in mistakes if m.untold]
    silent = sorted(set(missed) - set(excused))
    bad = [m.name for m, o in pairs if worse(o)]
    count = len(mistakes)
    return [
        Claim(
            "planted mistakes are reported",
            f"{count - len(missed)} of {count} right; missed {', '.join(silent) or 'none'}",
            f"all but at most {UNTOLD} that cannot be detected",
            not silent and len(excused) <= UNTOLD,
        ),
        Claim(
            "a fix leads to a model no further from the truth",
            f"{len(bad)} of {sum(o.fix is not None for o in found)} worse {', '.join(bad)}",
            "none",
            not bad,
        ),
    ]


def requested() -> list[Claim]:
    """As the command line asks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    chosen = [mistake for mistake in MISTAKES if options.only in mistake.name]
    if options.only:
        for mistake in chosen:
            found = one((mistake.name, options.seed))
            print(line_of(mistake, found), *found.sentences, *found.changes, sep="\n  ")
        sys.exit()
    return main(chosen, options.seed)


if __name__ == "__main__":
    main_of(requested)
