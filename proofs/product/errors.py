"""Mistakes get one clear message, exit code 2 and no leftovers; broken rows do not stop a fit."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from proofs.support.claims import Claim, main_of

sys.path.append(str(Path(__file__).parents[2] / "tests"))

from cli.mistakes import ROBOT, SPOILT, USAGE, USER, Mistake, faults, workshop  # noqa: E402


def run(arguments: Sequence[str], work: Path) -> subprocess.CompletedProcess[str]:
    """One command, as a user would run it."""
    command = [sys.executable, "-m", "steelyard", *arguments]
    return subprocess.run(command, cwd=work, capture_output=True, text=True)


def of_mistake(mistake: Mistake, work: Path) -> Claim:
    """One mistake; the figure is the first line of the answer."""
    done = run(mistake.arguments, work)
    wrong = faults(mistake, done.returncode, done.stdout, done.stderr, work)
    message = next(
        (line for line in done.stderr.splitlines() if line.startswith("error:")), "usage"
    )
    figure = "; ".join(wrong) or message.removeprefix("error: ")[:60]
    return Claim(mistake.name, figure, "message, exit code 2, nothing left", not wrong)


def of_broken_rows(work: Path) -> list[Claim]:
    """A log with rows that hold NaN, 1e293 or too few cells."""
    soiled = "../given/soiled.csv"
    shown = run(("identify", ROBOT, soiled, "-o", "shown"), work)
    done = run(("identify", ROBOT, soiled, "-o", "printed", "--json"), work)
    if shown.returncode or done.returncode:
        return [Claim("broken rows", shown.stderr[-200:], "the fit goes on", False)]
    notes = " ".join(json.loads(done.stdout)["notes"])
    spoilt = sum(SPOILT.values())
    terminal = " ".join(shown.stdout.split())
    claims = []
    for place, text in (("terminal", terminal), ("--json", notes)):
        counted = f"dropped {spoilt} of 1501 rows" in text
        figure = text[max(0, text.find("dropped")) :][:60]
        claims.append(Claim(f"broken rows counted, {place}", figure, f"{spoilt} rows", counted))
    return claims


def main() -> list[Claim]:
    """All mistakes, then a log with broken rows."""
    with tempfile.TemporaryDirectory() as folder:
        work = workshop(Path(folder))
        claims = [of_mistake(mistake, work) for mistake in (*USER, *USAGE)]
        return claims + of_broken_rows(work)


if __name__ == "__main__":
    main_of(main)
