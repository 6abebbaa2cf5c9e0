"""What a fleet's work begins with: its parts, the first model, and sums that are not there yet."""

import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import by_key
from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.files import cache_folder
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.information import Information
from steelyard.fleet.files_and_urls import Folder, on_disk, without_secrets
from steelyard.fleet.logs_by_robot_and_day import LogPart, natural, parts_of
from steelyard.fleet.part_information import FORMAT, PartSummary, PartWork, of_bytes, worked
from steelyard.fleet.remembered_work import RememberedWork, key_of
from steelyard.fleet.workers import each
from steelyard.identify.identify import identify
from steelyard.identify.runs_and_notes_of_logs import processing_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.runs.prepare import prepare
from steelyard.runs.runs_of_named_logs import log_files, paths_of, recording_of

SAMPLE = 6  # logs of the first day that decide cut-offs, friction laws and the first model
TRIED = 24  # logs of their first days that are tried for it, where some cannot be used


@dataclass(frozen=True, eq=False)
class FleetParts:
    """All parts with their keys, what is remembered of them, and what makes it."""

    parts: tuple[LogPart, ...]
    digests: tuple[str, ...]
    keys: tuple[str, ...]
    temperature: tuple[str, ...]  # columns
    reference: IdentifiedModel
    regressor: Regressor
    memory: RememberedWork
    nameless: tuple[str, ...] = ()  # files whose paths do not say robot and day, and why
    unread: Mapping[int, SteelyardError] = field(default_factory=dict)  # logs without a hash
    passing: dict[str, bytes] = field(default_factory=dict)  # what is not to be remembered

    def read(self, number: int) -> tuple[PartSummary, Information | None]:
        """Summary and sums of a part that is done."""
        if number in self.unread:
            error = self.unread[number]
            return PartSummary(wrong=error.wrong, fix=error.fix), None
        key = self.keys[number]
        content = self.passing.get(key) or self.memory.read(key)
        if content is None:
            raise LogError(
                "what was remembered of this log was lost meanwhile",
                where=self.parts[number].where,
                fix="check the store's disk, and run it again",
            )
        return of_bytes(content, self.regressor)

    def missing(self) -> list[int]:
        """Numbers of the parts that are not remembered, or damaged; of equal ones the first."""
        every = reversed(list(enumerate(self.keys)))
        first = {key: number for number, key in every if number not in self.unread}
        return [k for k in sorted(first.values()) if self.memory.read(self.keys[k]) is None]

    def make(
        self, numbers: Sequence[int], cluster: str | None, processes: int, progress: Progress
    ) -> None:
        """Make parts; each is remembered as soon as it is made."""
        common = PartWork(self.reference.text(), self.temperature)
        items = [(self.parts[k], self.digests[k]) for k in numbers]
        report_progress(progress, "logs", 0, len(items))
        ended = each(worked, common, items, cluster, processes)
        for done, (place, (content, remembered)) in enumerate(ended, start=1):
            key = self.keys[numbers[place]]
            if remembered:
                self.memory.write(key, content)
            else:
                self.passing[key] = content
            report_progress(progress, "logs", done, len(items), f"{done} of {len(items)}")


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
    parts, nameless = parts_of(paths_of(logs, 1), names)
    columns = (temperature,) if isinstance(temperature, str) else tuple(temperature)
    with ExitStack() as stack:
        place = store if store is not None else cache_folder("fleet")
        if place is None:  # the cache is switched off
            place = stack.enter_context(tempfile.TemporaryDirectory())
        memory, digests = RememberedWork(Folder(place)), list[str]()
        unread = dict[int, SteelyardError]()
        for number, part in enumerate(parts):
            report_progress(progress, "looking at logs", number, len(parts))
            try:
                digests.append(memory.digest(part.file))
            except SteelyardError as error:
                unread[number] = error
                digests.append(f"not read: {part.where}")
        if len(unread) == len(parts):
            raise unread[0]
        readable = [k for k in range(len(parts)) if k not in unread]
        reference = _reference(loaded, parts, digests, readable, memory, progress)
        if len(columns) not in (0, 1, len(reference.joints)):
            n = len(reference.joints)
            raise LogError(
                f"{len(columns)} columns of temperature do not fit {n} joints",
                where="temperature (--temperature)",
                fix="name one column for all joints, or one for each",
            )
        about = _about(model=key_of({"model": reference.text()}), temperature=columns)
        keys = tuple(
            key_of({**about, "log": digest, "rows": part.rows})
            for part, digest in zip(parts, digests, strict=True)
        )
        regressor = base_regressor(reference.model)
        known = parts, tuple(digests), keys, columns, reference, regressor, memory
        yield FleetParts(*known, nameless, unread)


def _about(**what: Any) -> dict[str, Any]:
    """What all entries depend on, beside what is their own."""
    return {"format": FORMAT, "version": version("steelyard"), **what}


def _reference(
    loaded: LoadedRobot,
    parts: Sequence[LogPart],
    digests: Sequence[str],
    readable: Sequence[int],
    memory: RememberedWork,
    progress: Progress,
) -> IdentifiedModel:
    """The model that changes are told from: of logs of the first days, one a robot and day."""
    of_robot = by_key((parts[k].robot, k) for k in readable)
    # the first logs of some robots, then their second ones: quiet days do not end the search
    robots = sorted(of_robot.values(), key=lambda mine: natural(parts[mine[0]].day))[:SAMPLE]
    turns = zip_longest(*robots)
    chosen = [k for turn in turns for k in turn if k is not None][:TRIED]
    robot, sample = (
        [s.sha256 for s in loaded.sources],
        [(digests[k], parts[k].rows) for k in chosen],
    )
    key = key_of(_about(robot=robot, sample=sample))
    known = memory.read(key)
    if known is None:
        known = _identified(loaded, [parts[k] for k in chosen], progress).text().encode()
        memory.write(key, known)
    return IdentifiedModel.from_dict(json.loads(known))


def _identified(
    loaded: LoadedRobot, parts: Sequence[LogPart], progress: Progress
) -> IdentifiedModel:
    """The model of the first of some logs that can be used, `SAMPLE` at most."""
    left, refused = list(parts), list[SteelyardError]()
    with ExitStack() as stack:
        places = {part: stack.enter_context(on_disk(part.file.url)) for part in parts}
        while left:
            now = left[:SAMPLE]
            texts = [f"{places[p]}{p.where[len(without_secrets(p.file.url)) :]}" for p in now]
            try:
                model = identify(loaded, texts, progress=progress).content.identified
                log = log_files(texts[:1])[0]
                run = prepare(recording_of(log, model.signals), processing_of(model))
                # joints that rest on some days rest below the same speed on all
                rest = tuple(np.asarray(run.rest_speed).tolist())
                return replace(model, processing=replace(run.chain.processing, rest_speed=rest))
            except SteelyardError as error:
                refused.append(error)
                bad = [p for p, text in zip(now, texts, strict=True) if _names(error, text, p)]
                left = [p for p in left if p not in (bad or now[:1])]
    raise LogError(
        f"none of the first {len(parts)} logs can be identified: {refused[0].wrong}",
        where=parts[0].where,
        fix="see `steelyard check` with such a log: it names what to correct in the robot file",
    )


def _names(error: SteelyardError, text: str, part: LogPart) -> bool:
    return text in error.where or Path(text).stem in f"{error.where} {error.wrong}".split()
