"""What one part of a log says about the parameters of a model: sums of products, as bytes."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, of_json_values
from steelyard.base.errors import PackageError, SteelyardError
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.logs.files_and_urls import digest, on_disk
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import Cut
from steelyard.logs.log_parts import LogPart
from steelyard.runs.prepare import prepare
from steelyard.runs.run import Run, spread_samples
from steelyard.runs.runs_of_named_logs import LogArgument, recording_of

FORMAT = 7  # raised whenever bytes of the same part would mean something else


@dataclass(frozen=True)
class PartWork:
    """What all parts share: the model as text, columns of temperature, most windows of a part."""

    model: str
    temperature: tuple[str, ...] = ()
    windows: int = 1


@dataclass(frozen=True)
class PartSummary:
    """What is known of a part beside its sums.

    `wrong` and `fix` say why it has none; times are those of the log's clock [s].
    """

    wrong: str = ""
    fix: str = ""
    at_rest: bool = False
    start: float = 0.0
    stop: float = 0.0
    samples: int = 0
    temperature: tuple[float, ...] = ()
    fastest: tuple[float, ...] = ()  # greatest speed of each joint
    motion: dict[str, Any] | None = None  # some samples, by which repetitions are recognised
    seconds: float = 0.0  # that the part took


@lru_cache(maxsize=2)
def _model(text: str) -> tuple[IdentifiedModel, Regressor]:
    model = IdentifiedModel.from_dict(json.loads(text))
    return model, base_regressor(model.model)


def worked(common: PartWork, item: tuple[LogPart, str]) -> tuple[bytes, bool]:
    """Summary and sums of a part, as bytes that `of_bytes` reads, and whether to remember them.

    An item is a part and the hash of its log's bytes. Errors of logs are part of the summary; they
    are remembered only where these bytes could be read, so that it is they that are wrong.
    """
    part, expected = item
    began = time.perf_counter()
    identified, regressor = _model(common.model)
    found, information, remembered = PartSummary(), None, True
    try:
        with on_disk(part.file.url) as path:
            cut = Cut() if part.rows is None else Cut(rows=part.rows)
            log = LogArgument(f"{path}{cut.text}", path, cut)
            open_log(path)
            recording = recording_of(log, identified.signals)
            run = prepare(recording, identified.processing, at_rest=True)
            found = _summary(run, _temperature(path, common.temperature, cut))
            if found.at_rest:
                found = replace(found, wrong="no joint moves", fix="nothing: robots rest")
            else:
                rests = identified.model.has_memory
                information = gather(regressor, run, rests=rests).merged(common.windows)
    except SteelyardError as error:
        found = replace(found, wrong=error.wrong, fix=error.fix)
        remembered = not isinstance(error, PackageError) and _has_bytes(part, expected)
    found = replace(found, seconds=time.perf_counter() - began)
    return to_bytes(found, information), remembered


def _has_bytes(part: LogPart, expected: str) -> bool:
    """Whether a log can be read here, and has the bytes that it is known by."""
    try:
        return digest(part.file) == expected
    except SteelyardError:
        return False


def _summary(run: Run, temperature: tuple[float, ...]) -> PartSummary:
    found = run.survey
    resting = found is None or found.band.frequency == 0.0
    origin = 0.0 if found is None else found.clock.origin
    first, last = (origin + t for t in (run.segments[0].start, run.segments[-1].stop))
    return PartSummary(
        at_rest=resting,
        start=first,
        stop=last,
        samples=sum(segment.samples for segment in run.segments),
        temperature=temperature,
        fastest=tuple(np.asarray(run.quality.max_speed).tolist()),
        motion=None if resting else spread_samples(run).to_dict(),
    )


def _temperature(path: Path, columns: Sequence[str], cut: Cut) -> tuple[float, ...]:
    """Mean of each column of temperature over the part; NaN of one that is not there or empty."""
    if not columns:
        return ()
    log = open_log(path)
    there = [name for name in columns if log.columns.count(name) == 1]
    total, count = np.zeros(len(there)), np.zeros(len(there))
    for rows in log.parts(there, cut.rows) if there else ():
        known = np.isfinite(rows)
        total += np.where(known, rows, 0.0).sum(axis=0)
        count += known.sum(axis=0)
    means = np.divide(total, count, out=np.full(len(there), np.nan), where=count > 0.0)
    by_name = dict(zip(there, means.tolist(), strict=True))
    return tuple(by_name.get(name, np.nan) for name in columns)


SUMS = ("grams", "absolute", "counts", "beside")


def to_bytes(summary: PartSummary, information: Information | None) -> bytes:
    """A line of JSON, then the sums as doubles, least significant byte first."""
    about: dict[str, Any] = {"format": FORMAT, "summary": vars(summary)}
    arrays = dict[str, Array]()
    if information is not None:
        arrays = {k: x for k in SUMS if (x := getattr(information, k)) is not None}
        about["signature"] = vars(information.signature)
        about["windows"] = [[w.run, w.start, w.stop] for w in information.windows]
    about["shapes"] = {name: x.shape for name, x in arrays.items()}
    head = json.dumps(about).encode() + b"\n"
    return head + b"".join(np.ascontiguousarray(x, "<f8").tobytes() for x in arrays.values())


def of_bytes(content: bytes, regressor: Regressor) -> tuple[PartSummary, Information | None]:
    """What `to_bytes` wrote."""
    head, _, rest = content.partition(b"\n")
    about: Mapping[str, Any] = json.loads(head)
    summary = of_json_values(PartSummary, about["summary"])
    if not about["shapes"]:
        return summary, None
    arrays, values, start = dict[str, Array](), np.frombuffer(rest, "<f8"), 0
    for name, shape in about["shapes"].items():
        size = int(np.prod(shape))
        arrays[name] = values[start : start + size].reshape(shape)
        start += size
    signature = of_json_values(Signature, about["signature"])
    windows = tuple(Window(*window) for window in about["windows"])
    return summary, Information(regressor.layout, signature, windows, **arrays)
