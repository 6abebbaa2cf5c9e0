"""What a fleet's work begins with: its parts, the first model, and sums that are not there yet."""

import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from steelyard.base.arrays import by_key
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.fleet.logs_by_robot_and_day import parts_of
from steelyard.identify.identify import identify
from steelyard.identify.remembered_parts import (
    SAMPLE,
    TRIED,
    DigestedParts,
    RememberedParts,
    about,
    of_first_usable,
    with_reading_of,
)
from steelyard.logs.log_parts import middle_of
from steelyard.logs.parquet import natural
from steelyard.logs.remembered_work import RememberedWork, key_of, remembered_work
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import refuse_floating
from steelyard.runs.runs_of_named_logs import paths_of


@dataclass(frozen=True, eq=False)
class FleetParts:
    """A fleet's parts, and files whose paths do not say robot and day."""

    remembered: RememberedParts
    nameless: tuple[str, ...] = ()  # and why


@contextmanager
def fleet_parts(
    loaded: LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    names: str | None,
    temperature: str | Iterable[str],
    store: str | Path | None,
    progress: Progress,
) -> Iterator[FleetParts]:
    """The parts of a fleet's logs, their first model, and what is remembered of them."""
    refuse_floating(loaded.robot, "the work on a fleet")
    parts, nameless = parts_of(paths_of(logs, 1), names)
    columns = (temperature,) if isinstance(temperature, str) else tuple(temperature)
    with remembered_work(store) as memory:
        digested = DigestedParts.of(parts, memory, progress)
        reference = _reference(loaded, digested, memory, progress)
        if len(columns) not in (0, 1, len(reference.joints)):
            n = len(reference.joints)
            raise LogError(
                f"{len(columns)} columns of temperature do not fit {n} joints",
                where="temperature (--temperature)",
                fix="name one column for all joints, or one for each",
            )
        known = RememberedParts.with_model(digested, reference, memory, columns)
        yield FleetParts(known, nameless)


def _reference(
    loaded: LoadedRobot, of: DigestedParts, memory: RememberedWork, progress: Progress
) -> IdentifiedModel:
    """The model that changes are told from: of logs of the first days, one a robot and day."""
    parts = of.parts
    of_robot = by_key((parts[k].robot, k) for k in of.readable)
    # the first logs of some robots, then their second ones: quiet days do not end the search
    robots = sorted(of_robot.values(), key=lambda mine: natural(parts[mine[0]].day))[:SAMPLE]
    turns = zip_longest(*robots)
    chosen = [k for turn in turns for k in turn if k is not None][:TRIED]
    middles = [middle_of(parts[k]) for k in chosen]
    robot = [s.sha256 for s in loaded.sources]
    sample = [(of.digests[k], part.rows) for k, part in zip(chosen, middles, strict=True)]
    key = key_of(about(robot=robot, sample=sample))
    known = memory.read(key)
    if known is None:

        def attempt(logs: list[str]) -> IdentifiedModel:
            found = identify(loaded, logs, progress=progress).content.identified
            return with_reading_of(found, logs[0])

        with ExitStack() as stack:
            model, _ = of_first_usable(middles, attempt, stack)
        known = model.text().encode()
        memory.write(key, known)
    return IdentifiedModel.from_dict(json.loads(known))
