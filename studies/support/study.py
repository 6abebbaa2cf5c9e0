"""A study: what is done for each seed, what is concluded, and its command line."""

import argparse
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from multiprocessing.pool import Pool
from pathlib import Path
from shutil import copytree, move
from typing import Generic, TypeVar

from studies.support.measured import NO_DATA, data_is_there
from studies.support.page import Code, Page, Section, Text

from steelyard import SteelyardError

SEEDS = 20
QUICK = 1
"""Seeds of a full and of a quick study, unless others are requested."""

T = TypeVar("T")


@dataclass(frozen=True)
class Study(Generic[T]):
    """A paper's experiment, replayed for several seeds.

    Attributes:
        name: Short name, such as `p4`; names of files begin with it.
        one: The experiment for one seed: a folder of its own to work in, the seed, and whether the
            study is a quick one. A function of a module, for other processes to find.
        page: What is concluded from the seeds.
        measured: The same methods on public logs of measured robots, once for all seeds: a folder
            of its own to work in, and whether the study is a quick one. A function of a module.
    """

    name: str
    one: Callable[[Path, int, bool], T]
    page: Callable[[Sequence[T]], Page]
    measured: Callable[[Path, bool], Section] | None = None


def whole_page(
    study: Study[T], folder: Path, seeds: int = SEEDS, *, quick: bool = False, processes: int = 2
) -> Page:
    """The experiment for seeds 0, 1, ... and for measured robots, and what is concluded.

    Progress goes to the terminal.

    Args:
        study: The study.
        folder: Where the folders of the seeds and of the measured robots are made.
        seeds: How many.
        quick: Whether the study is a quick one.
        processes: How many seeds run at the same time.
    """
    start, done = time.perf_counter(), []
    work = partial(_seed, study, folder, quick)
    with _pool(min(processes, seeds + (study.measured is not None))) as pool:
        beside = _measured(study, folder, quick, pool)
        for found in pool.imap(work, range(seeds)):
            done.append(found)
            past = time.perf_counter() - start
            left = past / len(done) * (seeds - len(done))
            words = f"{study.name}: seed {len(done)} of {seeds}, {past:.0f} s, {left:.0f} s left"
            print(words, file=sys.stderr, flush=True)
        return study.page(done).with_section(beside())


def _measured(
    study: Study[T], folder: Path, quick: bool, pool: Pool
) -> Callable[[], Section | None]:
    """Start the part on measured robots in a process of the pool; what waits for its result."""
    if study.measured is None:
        return lambda: None
    if not data_is_there():
        return lambda: NO_DATA
    place = folder / "measured"
    place.mkdir(parents=True)
    return pool.apply_async(study.measured, (place, quick)).get


def run(study: Study[T]) -> None:
    """The command line of a study: `python studies/NAME.py -o DIR [--quick] [--seeds N]`."""
    options = _options(study)
    target: Path = options.output
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        sys.exit(f"error: {target} exists already; give a new folder with -o")
    seeds = options.seeds or (QUICK if options.quick else SEEDS)
    start = time.perf_counter()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent) as place:
            work, page_folder = Path(place) / "seeds", Path(place) / "page"
            page_folder.mkdir()
            page = whole_page(study, work, seeds, quick=options.quick, processes=options.processes)
            seconds = time.perf_counter() - start
            page = replace(page, parts=(*page.parts, *_reproduced(study, seeds, seconds, options)))
            page.write(page_folder, study.name)
            for name in ("seed_00", "measured"):
                if (work / name).is_dir():
                    copytree(work / name, page_folder / name)
            if target.exists():
                target.rmdir()
            move(page_folder, target)
    except SteelyardError as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        sys.exit("stopped; nothing was written")
    print(f"{page.title}\n\n{page.lines()}\n")
    print(f"{seeds} seeds in {seconds:.0f} s")
    print(f"page: {target / study.name}.html; files of the first seed: {target / 'seed_00'}")
    missed = [claim.name for claim in page.claims if not claim.holds]
    if missed:
        sys.exit(f"bounds missed: {'; '.join(missed)}")


def _reproduced(
    study: Study[T], seeds: int, seconds: float, options: argparse.Namespace
) -> tuple[Text, Code]:
    """Run time, and how to run it again."""
    quick = " (quick form)" if options.quick else ""
    words = f"{seeds} seeds{quick} took {seconds:.0f} s on {options.processes} processes."
    script = f"studies/{Path(sys.argv[0]).name}"
    chosen = f" --seeds {seeds}" if seeds != (QUICK if options.quick else SEEDS) else ""
    command = f"python {script} -o {study.name}{' --quick' if options.quick else ''}{chosen}"
    lines = f"pip install .\n{command}\nxdg-open {study.name}/{study.name}.html"
    return Text("Run time, and how to run it again", (words,)), Code(lines)


def _options(study: Study[T]) -> argparse.Namespace:
    description = (sys.modules["__main__"].__doc__ or study.name).strip().splitlines()[0]
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="one seed, shorter searches")
    parser.add_argument("--seeds", type=_positive, metavar="N", help=f"{SEEDS} if left out")
    parser.add_argument("--processes", type=_positive, default=2, metavar="N")
    return parser.parse_args()


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("give 1 or more")
    return number


def _seed(study: Study[T], folder: Path, quick: bool, seed: int) -> T:
    place = folder / f"seed_{seed:02d}"
    place.mkdir(parents=True)
    return study.one(place, seed, quick)


@contextmanager
def _pool(processes: int) -> Iterator[Pool]:
    """Processes that end with the block, after an interrupt as well.

    Each of them computes on one processor: as many seeds as processors are run at a time.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # libraries read it when a process starts
    with get_context("spawn").Pool(processes, signal.signal, _IGNORED) as pool:
        yield pool


_IGNORED = (signal.SIGINT, signal.SIG_IGN)
"""Workers leave an interrupt to the parent, which ends them."""
