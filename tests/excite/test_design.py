"""What a design does once, and what it keeps of its time for the end."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from designing import random_starts
from excite.tabled import OPEN, QUICK, arm, designed, model_with_open_friction, problem_of
from steelyard.excite import searched_or_planned_motion as designs
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import EffortLimit
from steelyard.excite.constraints.certificate import certify, trajectory_hash
from steelyard.excite.search.parallel_search import (
    RESERVED_SECONDS,
    Found,
    ProcessPace,
    SearchBudget,
    SearchResult,
    time_after,
)
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory


def test_no_motion_is_proven_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen, proven = list[str](), EffortLimit.proven

    def counted(self: EffortLimit, motion: ExactTrajectory) -> object:
        seen.append(trajectory_hash(motion))
        return proven(self, motion)

    monkeypatch.setattr(EffortLimit, "proven", counted)
    found = designed(tmp_path, OPEN + QUICK)
    assert found.certificate.trajectory in seen
    assert len(seen) == len(set(seen))
    robot, proofs = arm(tmp_path, OPEN + QUICK).robot, found.certificate.proofs
    again = certify(robot, found.trajectory, found.limits, found.constraints)
    assert again.proofs == proofs


@dataclass(frozen=True)
class Paced:
    """A process that is so many times slower than alone."""

    slower: float


@pytest.mark.parametrize("slower", [1.0, 3.0, 40.0])
def test_time_is_kept_for_the_end_by_how_slow_the_machine_is(tmp_path: Path, slower: float) -> None:
    problem = problem_of(tmp_path, OPEN + QUICK)
    kept = time_after(problem, 20.0, Paced(slower))  # type: ignore[arg-type]
    most = 0.5 * 20.0  # at least half of the time remains for the search
    least = slower * RESERVED_SECONDS
    assert min(least, 0.3 * 20.0) <= kept <= min(least + 0.5 * slower, most)


def test_the_pace_is_that_of_clock_and_processor() -> None:
    pace = ProcessPace(time.monotonic() - 300.0, time.process_time() - 100.0)
    assert pace.slower == pytest.approx(3.0, rel=0.1)
    assert ProcessPace(time.monotonic(), time.process_time() - 100.0).slower == 1.0


def test_what_comes_before_the_search_is_taken_from_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = list[float]()

    def watched(*arguments: object) -> None:
        given.append(next(x for x in arguments if isinstance(x, SearchBudget)).seconds)
        raise StopIteration

    monkeypatch.setattr(designs, "search_in_parallel", watched)
    loaded = arm(tmp_path, OPEN + QUICK)
    with pytest.raises(StopIteration):
        designs.design(
            (loaded, model_with_open_friction(loaded), None),
            SearchBudget(20.0),
            since=time.monotonic() - 5.0,
        )
    assert given[0] < 20.0 - 5.0 - RESERVED_SECONDS


def test_the_best_motion_is_finished_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(tmp_path, OPEN + QUICK)
    starts = random_starts(problem.inequalities, np.random.default_rng(0), 3)
    best, middle, worst = sorted(starts, key=problem.criterion_value)
    found = tuple(
        Found(k, x, problem.criterion_value(x), True) for k, x in enumerate((best, middle))
    )
    monkeypatch.setattr(designs, "composed_motions", lambda *arguments: iter([worst]))
    first, *rest = designs._candidates(problem, SearchResult(found, 2, (), False), None)
    assert first is best and len(rest) == 2
    given = designs._candidates(problem, SearchResult(found[1:], 2, (), False), best)
    assert given[0] is best and len(given) == 3
