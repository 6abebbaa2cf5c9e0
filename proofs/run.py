"""`make prove`: all proofs into one table; fails where one is missed, or without the data.

Two proofs run side by side, each in a process of its own; those that measure time (`TIMED = True`)
run alone behind them. Results are kept in `results/proofs/`, by commit: a run that was stopped goes
on where it was. `python -m proofs.run checks` and `checks/pairs` run some, `--again` runs all anew.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from proofs.support.claims import Claim, data_folder, table

HERE = Path(__file__).parent
PROCESS = """
import importlib, json, sys
from dataclasses import asdict
claims = importlib.import_module("proofs." + sys.argv[1].replace("/", ".")).main()
found = [{**asdict(claim), "holds": bool(claim.holds)} for claim in claims]
json.dump(found, open(sys.argv[2], "w"))
"""


def main() -> int:
    """Run every proof, or those that arguments name."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("proofs", nargs="*", help="beginnings of names, such as checks/pairs")
    options.add_argument("-j", "--jobs", type=int, default=2, help="proofs at a time (default 2)")
    options.add_argument("--again", action="store_true", help="run also what has a result")
    given = options.parse_args()
    data_folder()
    every = {
        path.relative_to(HERE).with_suffix("").as_posix(): _is_timed(path)
        for path in sorted(HERE.glob("*/*.py"))
        if path.parent.name != "support"
    }
    names = [name for name in every if name.startswith(tuple(given.proofs or every))]
    if not names:
        named = " or ".join(given.proofs)
        print(f"no proof begins with {named}; there are {', '.join(every)}")
        return 1
    folder = HERE.parent / "results" / "proofs" / _version()
    folder.mkdir(parents=True, exist_ok=True)
    todo = [x for x in names if given.again or not _result(folder, x).exists()]
    pool = ThreadPoolExecutor(given.jobs)
    try:
        list(pool.map(lambda name: _run(name, folder), [x for x in todo if not every[x]]))
        for name in todo:
            if every[name]:
                _run(name, folder)
    except KeyboardInterrupt:
        pool.shutdown(cancel_futures=True)
        print(f"stopped; results are kept in {folder}: run it again to go on", file=sys.stderr)
        return 130
    claims = [claim for name in names for claim in _claims(folder, name)]
    print(table(claims))
    missed = sum(not claim.holds for claim in claims)
    print(f"{len(claims) - missed} claims hold, {missed} missed")
    return 1 if missed else 0


def _is_timed(path: Path) -> bool:
    return re.search(r"^TIMED = True", path.read_text("utf-8"), re.M) is not None


def _version() -> str:
    """The commit, and a hash of what is changed beside it; `unknown` outside of a clone."""
    told = [_git("rev-parse", "--short=12", "HEAD"), _git("diff", "HEAD")]
    if not told[0]:
        return "unknown"
    changed = subprocess.run(
        ["git", "hash-object", "--stdin"], input=told[1], capture_output=True, text=True, check=True
    )
    return told[0] + (f"-{changed.stdout[:8]}" if told[1] else "")


def _git(*arguments: str) -> str:
    done = subprocess.run(
        ["git", *arguments], cwd=HERE, capture_output=True, text=True, check=False
    )
    return done.stdout.strip()


def _result(folder: Path, name: str) -> Path:
    return folder / f"{name.replace('/', '.')}.json"


def _run(name: str, folder: Path) -> None:
    """One proof into its file; what it prints beside."""
    start, path = time.perf_counter(), _result(folder, name)
    part = path.with_suffix(".part")
    with path.with_suffix(".txt").open("w") as said:
        done = subprocess.run(
            [sys.executable, "-c", PROCESS, name, str(part)],
            cwd=HERE.parent,
            stdout=said,
            stderr=subprocess.STDOUT,
            check=False,
        )
    if done.returncode in (-signal.SIGINT, 130):
        raise KeyboardInterrupt
    if done.returncode != 0 or not part.exists():
        words = path.with_suffix(".txt").read_text(errors="replace").strip().splitlines()[-1:]
        stopped = Claim("the proof stopped with an error", " ".join(words), "figures", False)
        part.write_text(json.dumps([asdict(stopped)]))
    seconds = time.perf_counter() - start
    claims = [{**one, "name": f"{name}  {one['name']}"} for one in json.loads(part.read_text())]
    part.write_text(json.dumps({"seconds": seconds, "claims": claims}, indent=1))
    part.replace(path)
    missed = sum(not one["holds"] for one in claims)
    print(f"{name}: {seconds:.0f} s, {missed} of {len(claims)} missed", file=sys.stderr, flush=True)


def _claims(folder: Path, name: str) -> Sequence[Claim]:
    return [Claim(**one) for one in json.loads(_result(folder, name).read_text())["claims"]]


if __name__ == "__main__":
    sys.exit(main())
