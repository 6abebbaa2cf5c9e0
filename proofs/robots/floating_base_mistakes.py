"""Mistakes planted in logs of legged robots, one at a time: which does `check` name?

A simulated A1 trots with sensors in its feet, a G1 hangs on a hoist with a force sensor; bodies are
not those of the model file, by 15 % in mass and 1 cm in their centres. Each mistake is to be named
for what it is, by a finding that is doubtful or wrong; clean logs are to raise none.
`python -m proofs.robots.floating_base_mistakes A1` plants those of one robot.
"""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.floating_base_mistakes import Mistake, mistakes_of
from proofs.support.legged_robots import LEGGED, Simulation
from proofs.support.legged_trials import Trial, trial

import steelyard
from steelyard.base.errors import SteelyardError
from steelyard.check.finding import Finding

LEAST_NAMED = 0.9  # share of the mistakes of a robot: 18 of 20
SECONDS = 15.0
SLIP = Mistake("a foot slips", lambda columns, text: text, (("slipping feet", "slips"),))


@dataclass(frozen=True, eq=False)
class Checked:
    """What is found in a log with a mistake."""

    mistake: Mistake
    found: tuple[Finding, ...]
    refused: str = ""  # why it cannot be read at all

    @property
    def named(self) -> bool:
        """Whether the mistake is called what it is."""
        said = [f"{one.check}: {one.says}" for one in self.found]
        return any(
            all(word in one for word in group) for one in said for group in self.mistake.named
        )

    @property
    def line(self) -> str:
        """Name, verdict, and what is found."""
        said = "; ".join(f"{f.severity.word} {f.check}" for f in self.found) or self.refused
        return f"{'named' if self.named else 'NOT NAMED':<10} {self.mistake.name:<50} {said}"


def suspicious(file: Path, log: Path) -> tuple[Finding, ...]:
    """Findings that are not ok or open."""
    return tuple(f for f in steelyard.check(file, log).last.findings if f.severity)


def checked(mistake: Mistake, log: Path, file: Path, folder: Path) -> Checked:
    """One mistake, planted and checked."""
    wrong, changed = mistake.write(log, file, folder)
    try:
        return Checked(mistake, suspicious(changed, wrong))
    except SteelyardError as error:
        return Checked(mistake, (), str(error))


def slipping(folder: Path) -> Path:
    """A log of an A1 with ice under one foot."""
    robot, log = LEGGED["A1"], folder / "slips.parquet"
    path = data_folder().parent / "models" / robot.file
    Simulation(path, robot, 0, slippery=robot.feet[0]).log(log, SECONDS, 1, 2.0)
    return log


def of_robot(name: str, tried: Trial, log: Path, folder: Path) -> Iterator[Claim]:
    """No alarm on clean logs, and the mistakes that are named in one of them."""
    for number, clean in enumerate(tried.logs):
        found = suspicious(tried.file, clean)
        said = ", ".join(f.check for f in found) or "no finding"
        yield Claim(f"{name}, clean log {number + 1}", said, "no finding", not found)
    cases = list[Checked]()
    logs = [(mistake, log) for mistake in mistakes_of(name, tried.file)]
    logs += [] if LEGGED[name].hung else [(SLIP, slipping(folder))]
    for number, (mistake, own) in enumerate(logs):
        cases.append(checked(mistake, own, tried.file, folder / f"{name}{number}"))
        print(f"{name}: {cases[-1].line}", flush=True)
    named, count = sum(case.named for case in cases), len(cases)
    bound = f">= {100.0 * LEAST_NAMED:.0f} %"
    value = f"{named} of {count}"
    yield Claim(f"{name}, mistakes named", value, bound, named >= LEAST_NAMED * count)


# frequencies of the gaits [Hz], and which log mistakes are planted in
ROBOTS = {"A1": ([0.0, 2.0, 3.0], 1), "G1": ([0.0, 0.0], 0)}


def main(*names: str) -> list[Claim]:
    """Both robots, or those named."""
    claims = list[Claim]()
    with tempfile.TemporaryDirectory() as place:
        for name in names or ROBOTS:
            gaits, chosen = ROBOTS[name]
            tried = trial(name, Path(place), gaits)
            claims += of_robot(name, tried, tried.logs[chosen], Path(place))
    return claims


if __name__ == "__main__":
    main_of(lambda: main(*sys.argv[1:]))
