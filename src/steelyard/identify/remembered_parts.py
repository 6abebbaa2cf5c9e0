"""Parts of many logs, their sums of products, made by workers and remembered, and a first model."""

import re
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from steelyard.base.errors import LogError, SteelyardError
from steelyard.base.progress import Progress, report_progress
from steelyard.base.workers import each
from steelyard.estimate.changes_from_model import LocalParameters, NormalEquations
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.part_information import (
    FORMAT,
    PartSummary,
    PartWork,
    of_bytes,
    worked,
)
from steelyard.estimate.logs_left_out import LeftOut, logs_left_out
from steelyard.identify.runs_and_notes_of_logs import processing_of
from steelyard.logs.files_and_urls import on_disk
from steelyard.logs.log_parts import LogPart
from steelyard.logs.remembered_work import RememberedWork, key_of
from steelyard.runs.prepare import prepare
from steelyard.runs.runs_of_named_logs import log_files, recording_of

SAMPLE = 6  # logs that decide cut-offs, friction laws and the first model
TRIED = 24  # logs that are tried for it, where some cannot be used

Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class DigestedParts:
    """Parts of logs with the hashes of their bytes; errors of logs that have none."""

    parts: tuple[LogPart, ...]
    digests: tuple[str, ...]
    unread: dict[int, SteelyardError]

    @classmethod
    def of(
        cls, parts: Sequence[LogPart], memory: RememberedWork, progress: Progress
    ) -> "DigestedParts":
        """Hash logs that are not known by their size and stamp; an error where none can be read."""
        digests, unread, known = list[str](), dict[int, SteelyardError](), dict[str, str]()
        for number, part in enumerate(parts):
            report_progress(progress, "looking at logs", number, len(parts))
            try:
                if part.file.url not in known:
                    known[part.file.url] = memory.digest(part.file)
                digests.append(known[part.file.url])
            except SteelyardError as error:
                unread[number] = error
                digests.append(f"not read: {part.where}")
        if len(unread) == len(parts):
            raise unread[0]
        return cls(tuple(parts), tuple(digests), unread)

    def without_copies(self) -> tuple["DigestedParts", tuple[str, ...]]:
        """The parts without those that have the bytes of one before them, and which these are."""
        seen, kept, copies = dict[object, int](), list[int](), list[str]()
        for number, (part, digest) in enumerate(zip(self.parts, self.digests, strict=True)):
            before = seen.setdefault((digest, part.rows), number)
            if before == number:
                kept.append(number)
            else:
                copies.append(f"{part.where}: it has the same bytes as {self.parts[before].where}")
        unread = {k: self.unread[number] for k, number in enumerate(kept) if number in self.unread}
        parts, digests = (self.parts[k] for k in kept), (self.digests[k] for k in kept)
        return DigestedParts(tuple(parts), tuple(digests), unread), tuple(copies)

    @property
    def readable(self) -> list[int]:
        """Numbers of the parts that can be read."""
        return [k for k in range(len(self.parts)) if k not in self.unread]


@dataclass(frozen=True, eq=False)
class RememberedParts:
    """All parts with their keys, what is remembered of them, and what makes it."""

    of: DigestedParts
    work: PartWork
    keys: tuple[str, ...]
    reference: IdentifiedModel
    regressor: Regressor
    memory: RememberedWork
    passing: dict[str, bytes] = field(default_factory=dict)  # what is not to be remembered

    @classmethod
    def with_model(
        cls,
        of: DigestedParts,
        reference: IdentifiedModel,
        memory: RememberedWork,
        temperature: tuple[str, ...] = (),
        windows: int = 1,
    ) -> "RememberedParts":
        """The parts of logs for a model that says how they are read."""
        work = PartWork(reference.text(), temperature, windows)
        shared = about(model=key_of({"model": work.model}), temperature=temperature, most=windows)
        keys = tuple(
            key_of({**shared, "log": digest, "rows": part.rows})
            for part, digest in zip(of.parts, of.digests, strict=True)
        )
        return cls(of, work, keys, reference, base_regressor(reference.model), memory)

    @property
    def parts(self) -> tuple[LogPart, ...]:
        """Which rows of which logs."""
        return self.of.parts

    def read(self, number: int) -> tuple[PartSummary, Information | None]:
        """Summary and sums of a part that is done."""
        if number in self.of.unread:
            error = self.of.unread[number]
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
        first = {key: number for number, key in every if number not in self.of.unread}
        return [k for k in sorted(first.values()) if self.memory.read(self.keys[k]) is None]

    def make(
        self, numbers: Sequence[int], cluster: str | None, processes: int, progress: Progress
    ) -> None:
        """Make parts; each is remembered as soon as it is made."""
        items = [(self.parts[k], self.of.digests[k]) for k in numbers]
        report_progress(progress, "logs", 0, len(items))
        ended = each(worked, self.work, items, cluster, processes)
        for done, (place, (content, remembered)) in enumerate(ended, start=1):
            key = self.keys[numbers[place]]
            if remembered:
                self.memory.write(key, content)
            else:
                self.passing[key] = content
            report_progress(progress, "logs", done, len(items), f"{done} of {len(items)}")

    def counted(
        self, local: LocalParameters, progress: Progress
    ) -> tuple[list[PartSummary], list[NormalEquations | None], dict[int, LeftOut], list[int]]:
        """Summaries of all parts, what they say of changes, which do not count and which do.

        A `LogError` if none counts.
        """
        summaries, equations = list[PartSummary](), list[NormalEquations | None]()
        for number in range(len(self.parts)):
            report_progress(progress, "adding up", number, len(self.parts))
            summary, information = self.read(number)
            summaries.append(summary)
            equations.append(None if information is None else local.equations(information))
        out = logs_left_out(self.parts, self.of.digests, summaries, equations, local)
        used = [number for number in range(len(self.parts)) if number not in out]
        if not used:
            first = out[min(out)]
            raise LogError(f"no log can be used: {first.wrong}", where=first.log, fix=first.fix)
        return summaries, equations, out, used


def about(**what: Any) -> dict[str, Any]:
    """What all entries depend on, beside what is their own."""
    return {"format": FORMAT, "version": version("steelyard"), **what}


def of_first_usable(
    parts: Sequence[LogPart],
    attempt: Callable[[list[str]], Found],
    stack: ExitStack,
    *,
    blame_first: bool = True,
) -> tuple[Found, list[str]]:
    """What comes of the first `SAMPLE` of some logs that can be used together, and their texts.

    `attempt` takes the logs as texts and refuses with a `SteelyardError`; the logs that it names
    are then left out. Where it names none of them, that is the first one, or with `blame_first`
    false an error of something else, which is raised. Copies of URLs stay as long as the `stack`.
    """
    left, refused, places = list(parts), list[SteelyardError](), dict[str, Path]()
    while left:
        now, texts = left[:SAMPLE], list[str]()
        try:
            for part in now:
                url = part.file.url
                if url not in places:
                    places[url] = stack.enter_context(on_disk(url))
                texts.append(f"{places[url]}{part.cut}")
            return attempt(texts), texts
        except SteelyardError as error:
            refused.append(error)
            named = list(zip(now, texts, strict=False))  # the last one may not have been copied
            bad = [part for part, text in named if text in error.where]
            bad = bad or [part for part, text in named if _names(error, text)]
            if not bad and len(texts) == len(now) and not blame_first:
                raise
            left = [part for part in left if part not in (bad or now[:1])]
    if len(parts) == 1:
        raise refused[0]
    raise LogError(
        f"no sample of {len(parts)} logs can be identified, the first one: {refused[0].wrong}",
        where=parts[0].where,
        fix="see `steelyard check` with such a log: it names what to correct in the robot file",
    )


def _names(error: SteelyardError, text: str) -> bool:
    """Whether an error names a log by its file's name."""
    name = re.escape(Path(text).stem)
    named = re.compile(rf"(?<![\w.]){name}(?!\w|\.\d)")
    return named.search(f"{error.where} {error.wrong}") is not None


def with_reading_of(model: IdentifiedModel, log: str) -> IdentifiedModel:
    """The model with the processing that a log came to, so that all logs are read alike.

    Joints that rest in some logs rest below the same speed in all.
    """
    first = log_files([log])[0]
    run = prepare(recording_of(first, model.signals), processing_of(model))
    rest = tuple(np.asarray(run.rest_speed).tolist())
    return replace(model, processing=replace(run.chain.processing, rest_speed=rest))
