"""Every public robot model file that is there: read right, refused rightly, or a fault of ours.

Each file is read as `steelyard init FILE` reads it, in a child process with a time limit. What is
read is compared with Pinocchio (URDF) or MuJoCo (MJCF): torques with the file's bodies at random
states, and the number of base parameters against the rank of the other's regressor. What is
refused is compared with what the file is, see `support/model_facts.py`.

The files are looked for in the folders named by `--folder` and by STEELYARD_MODELS, beside the
robots' data, and in the examples. `--fetch FOLDER` downloads packages with model files and unpacks
them there. `--list CLASS` prints the files of a class, `--only TEXT` takes paths with this text.
"""

import argparse
import json
import multiprocessing
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from proofs.support.claims import Claim, table
from proofs.support.model_files import FAMILIES, ModelFile, fetch, folders, model_files
from proofs.support.model_judge import CLOSELY, Severity, judged

LONGEST = 300.0
"""Seconds that a stage of a file may take."""
KINDS = ("read right", "no oracle", "refused rightly", "refused wrongly", "wrong")

Found = list[tuple[ModelFile, Severity]]


def main(
    named: Sequence[Path] = (), only: str = "", jobs: int = 1, listed: str = "", output: str = ""
) -> list[Claim]:
    """Every file of every folder."""
    places = folders(named)
    files = [file for file in model_files(places) if only in str(file.path)]
    if not files:
        return [Claim("model files", "none", "some: name folders in STEELYARD_MODELS", False)]
    found = list(judgements(files, jobs, _writer(output)))
    for file, severity in found:
        if listed and listed in f"{severity.kind}: {severity.why}":
            print(f"{file.path}\n    {severity.kind}: {severity.why}: {severity.detail}")
    print(shown(found))
    return claims_of(found)


def _writer(output: str) -> Callable[[ModelFile, Severity], None]:
    """What notes a severity as soon as it is there."""
    if not output:
        return lambda file, severity: None
    Path(output).write_text("", encoding="utf-8")

    def note(file: ModelFile, severity: Severity) -> None:
        line = {"path": str(file.path), "family": file.family, **asdict(severity)}
        with Path(output).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(line) + "\n")

    return note


def claims_of(found: Found) -> list[Claim]:
    """Nothing wrong, nothing refused wrongly, by family."""
    claims = []
    for family in FAMILIES:
        robots = [j for f, j in found if f.family == family and j.kind != "not a robot"]
        if not robots:
            continue
        counts = Counter(severity.kind for severity in robots)
        bad = {kind: counts[kind] for kind in ("wrong", "refused wrongly") if counts[kind]}
        figure = f"{counts['read right']} read right, {counts['refused rightly']} refused rightly"
        figure += "".join(f", {count} {kind}" for kind, count in bad.items())
        claims.append(Claim(f"{len(robots)} robots in {family}", figure, "0 others", not bad))
    return claims


def shown(found: Found) -> str:
    """The table by family, and under it every class with its count and an example."""
    lines = [f"{'family':<12}{'files':>7}{'robots':>8}" + "".join(f"{k:>17}" for k in KINDS)]
    for family in FAMILIES:
        own = [j for f, j in found if f.family == family]
        counts = Counter(severity.kind for severity in own)
        robots = len(own) - counts["not a robot"]
        cells = "".join(f"{counts[kind]:>17}" for kind in KINDS)
        lines.append(f"{family:<12}{len(own):>7}{robots:>8}{cells}")
    read = [severity for _, severity in found if severity.kind == "read right"]
    far = sum(severity.error > CLOSELY for severity in read)
    cleaned = sum(severity.cleaned for severity in read)
    lines.append(f"of those read, {far} differ by more than {CLOSELY:.0e} in torque; {cleaned} "
                 "agree where rounded angles are put right")  # fmt: skip
    classes: dict[tuple[str, str, str], list[Path]] = {}
    for file, severity in found:
        if severity.kind != "read right" or severity.why:
            key = severity.kind, file.family, severity.why
            classes.setdefault(key, []).append(file.path)
    for (kind, family, why), paths in sorted(classes.items()):
        lines.append(f"{len(paths):>5}  {kind}, {family}: {why}  (e.g. {paths[0]})")
    return "\n".join(lines)


def judgements(
    files: Sequence[ModelFile], jobs: int, note: Callable[[ModelFile, Severity], None]
) -> Iterator[tuple[ModelFile, Severity]]:
    """Every file with its severity, in the order of the files."""

    def part_of(part: Sequence[ModelFile]) -> list[Severity]:
        return list(_in_a_child(part, note))

    with ThreadPoolExecutor(jobs) as threads:
        done = list(threads.map(part_of, [files[k::jobs] for k in range(jobs)]))
    for number, file in enumerate(files):
        yield file, done[number % jobs][number // jobs]


def _in_a_child(
    files: Iterable[ModelFile], note: Callable[[ModelFile, Severity], None]
) -> Iterator[Severity]:
    """Judgements from a child process; another one takes over where it dies or hangs."""
    context = multiprocessing.get_context("spawn")
    child: Any = None
    pipe: Any = None
    for file in files:
        if child is None:
            pipe, other = context.Pipe()
            child = context.Process(target=work, args=(other,), daemon=True)
            child.start()
            other.close()
        pipe.send(file)
        severity = _answer(pipe)
        if severity.why in (_HANG, _DEATH, _SLOW):
            child.kill()
            child.join()
            child = None
        note(file, severity)
        yield severity
    if child is not None:
        child.kill()
        child.join()


_HANG, _DEATH, _SLOW = "hang", "the process died", "the judge takes too long"


def _answer(pipe: Connection) -> Severity:
    stage = "begin"
    while True:
        try:
            if not pipe.poll(LONGEST):
                hang = stage == "reading"
                return Severity("wrong" if hang else "no oracle", _HANG if hang else _SLOW)
            answer = pipe.recv()
        except (EOFError, ConnectionError):
            kind = "wrong" if stage == "reading" else "no oracle"
            return Severity(kind, _DEATH, f"while {stage}")
        if isinstance(answer, Severity):
            return answer
        stage = answer


def work(pipe: Connection) -> None:
    """Judge files as they are named; what is compiled for them is not kept."""
    os.environ["STEELYARD_CACHE"] = ""
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    while True:
        file = pipe.recv()
        try:
            pipe.send(judged(file, pipe.send))
        except Exception as error:
            pipe.send(Severity("no oracle", "the judge failed", f"{type(error).__name__}: {error}"))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--folder", type=Path, action="append", default=[])
    parser.add_argument("--fetch", type=Path, metavar="FOLDER")
    parser.add_argument("--only", default="")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--list", default="", metavar="CLASS")
    parser.add_argument("--output", default="", help="severities as JSON, one a line")
    return parser.parse_args()


if __name__ == "__main__":
    given = _arguments()
    if given.fetch:
        fetch(given.fetch)
        given.folder.append(given.fetch)
    claims = main(given.folder, given.only, given.jobs, given.list, given.output)
    print(table(claims))
    raise SystemExit(not all(claim.holds for claim in claims))
