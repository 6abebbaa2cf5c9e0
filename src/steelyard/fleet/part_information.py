"""What one part of a log says about the parameters of a model: sums of products, as bytes."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.fleet.files_and_urls import on_disk
from steelyard.fleet.logs_by_robot_and_day import LogPart
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import Cut
from steelyard.runs.prepare import prepare
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument, recording_of

FORMAT = 4  # raised whenever bytes of the same part would mean something else


@dataclass(frozen=True)
class PartWork:
    """What all parts share: the model as text, and columns of temperature."""

    model: str
    temperature: tuple[str, ...] = ()


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
    seconds: float = 0.0  # that the part took


@lru_cache(maxsize=2)
def _model(text: str) -> tuple[IdentifiedModel, Regressor]:
    model = IdentifiedModel.from_dict(json.loads(text))
    return model, base_regressor(model.model)


def worked(common: PartWork, part: LogPart) -> bytes:
    """Summary and sums of a part, as bytes that `of_bytes` reads; errors of logs are part of it."""
    began = time.perf_counter()
    identified, regressor = _model(common.model)
    found, information = PartSummary(), None
    try:
        with on_disk(part.file.url) as path:
            cut = Cut() if part.rows is None else Cut(rows=part.rows)
            log = LogArgument(f"{path}{cut.text}", path)
            open_log(path)
            recording = recording_of(log, identified.signals)
            run = prepare(recording, identified.processing, at_rest=True)
            found = _summary(run, _temperature(path, common.temperature, cut))
            if found.at_rest:
                found = replace(found, wrong="no joint moves", fix="nothing: robots rest")
            else:
                rests = identified.model.has_memory
                information = gather(regressor, run, rests=rests).merged(1)
    except SteelyardError as error:
        found = replace(found, wrong=error.wrong, fix=error.fix)
    found = replace(found, seconds=time.perf_counter() - began)
    return to_bytes(found, information)


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
    )


def _temperature(path: Any, columns: Sequence[str], cut: Cut) -> tuple[float, ...]:
    """Mean of each column of temperature over the part; nothing without columns."""
    if not columns:
        return ()
    total, count = np.zeros(len(columns)), np.zeros(len(columns))
    for rows in open_log(path).parts(columns, cut.rows):
        known = np.isfinite(rows)
        total += np.where(known, rows, 0.0).sum(axis=0)
        count += known.sum(axis=0)
    return tuple((total / np.maximum(count, 1.0)).tolist())


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
    summary = PartSummary(**_with_tuples(about["summary"]))
    if not about["shapes"]:
        return summary, None
    arrays, values, start = dict[str, Array](), np.frombuffer(rest, "<f8"), 0
    for name, shape in about["shapes"].items():
        size = int(np.prod(shape))
        arrays[name] = values[start : start + size].reshape(shape)
        start += size
    signature = Signature(**_with_tuples(about["signature"]))
    windows = tuple(Window(*window) for window in about["windows"])
    return summary, Information(regressor.layout, signature, windows, **arrays)


def _with_tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values with tuples in the place of JSON's lists."""
    return {k: tuple(x) if isinstance(x, list) else x for k, x in values.items()}
