"""Public logs of measured robots: where they are, their robot files, errors of models on them."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import tomlkit
from studies.support.page import Section, Table, Text
from studies.support.robots import changed

import steelyard

EXAMPLES = Path(__file__).parents[2] / "examples"
HEADING = "Measured robots"

NO_DATA = Section(
    (
        Text(
            HEADING,
            (
                "Left out: set STEELYARD_DATA to the folder with the public logs (docs/data.md "
                "lists them and where they come from).",
            ),
        ),
    )
)
"""In place of the section on measured robots where their logs are not there."""

UR10E_RUNS = (
    "ur-20_02_05-20sec_8harm",
    "ur-20_02_05-20sec_12harm",
    "ur-20_02_06-20sec_5harm",
    "ur-20_02_10-20sec_7harm",
    "ur-20_02_10-30sec_12harm",
    "ur-20_02_12-40sec_12harm",
    "ur-20_02_19_14harm50sec",
)
"""Fourier motions of the UR10e without load."""

UR10E_PROCESS = "ur10e/validation/ur-20_01_17-ptp_10_points.parquet"
"""Its motion from point to point through ten postures, twice or more, with rests."""

PANDA = "panda/panda_gaz2019_trajectory1.parquet"
AR5 = "rokae_ar5/ar5_run1_rows0_2300.parquet"
"""One run each."""


def data_is_there() -> bool:
    """Whether `STEELYARD_DATA` names a folder."""
    named = os.environ.get("STEELYARD_DATA")
    return bool(named) and Path(str(named)).is_dir()


def log(name: str, window: str = "") -> str:
    """A log of the data folder.

    Args:
        name: Path within the folder.
        window: Seconds or rows, such as `@0:34` or `#635:3510`.
    """
    return str(Path(os.environ["STEELYARD_DATA"]) / name) + window


def ur10e(*names: str) -> list[str]:
    """Identification runs of the UR10e by name."""
    return [log(f"ur10e/identification/{name}.parquet") for name in names]


def example(name: str, target: Path, tables: str = "", *, laws_from_data: bool = True) -> Path:
    """Write a robot file of `examples/` with some of its tables changed.

    Args:
        name: File in `examples/`, without its suffix.
        target: File to write.
        tables: TOML, see `studies.support.robots.changed`.
        laws_from_data: Whether the file's `friction = "auto"` stays, if it has one.

    Returns:
        `target`.
    """
    document = tomlkit.parse((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    if not laws_from_data:
        document["model"].pop("friction", None)
    return changed(document, target, tables)


@dataclass(frozen=True)
class Errors:
    """Errors of one model on one log, below the cut-off of the printed errors.

    Attributes:
        joints: Names.
        percent: Root mean square error of each joint where it moves, then of all together, as a
            share of the effort used [%]; NaN of a joint that rests.
        rms: The same [unit].
        absolute: Mean absolute error of each joint where it moves [unit].
        unit: Of `rms` and `absolute`.
    """

    joints: tuple[str, ...]
    percent: tuple[float, ...]
    rms: tuple[float, ...]
    absolute: tuple[float, ...]
    unit: str


def errors_on(
    models: Mapping[str, steelyard.IdentifiedModel], one_log: str, like: str
) -> dict[str, Errors]:
    """Errors of models on a log.

    Args:
        models: By name.
        one_log: The log.
        like: Model whose processing all of them have there, so that all predict the same efforts.
    """
    first = {like: models[like]} | dict(models)
    found = steelyard.compare_models(first, one_log).to_dict()
    whole = {one["model"]: one for one in found["all_joints"]}
    made = {}
    for name in models:
        rows = [row for row in found["errors"] if row["model"] == name]
        moving = [row | ({} if row["moving"] else {"percent_of_used": None}) for row in rows]
        made[name] = Errors(
            tuple(row["joint"] for row in rows),
            _numbers([*moving, whole[name]], "percent_of_used"),
            _numbers([*rows, whole[name]], "rmse"),
            _numbers(rows, "mae"),
            whole[name]["unit"],
        )
    return made


def _numbers(rows: Sequence[Mapping[str, float | None]], key: str) -> tuple[float, ...]:
    values = (row[key] for row in rows)
    return tuple(float("nan") if value is None else value for value in values)


def percent_table(title: str, by_model: Mapping[str, Errors]) -> Table:
    """A row per joint and one of all, a column per model: share of the effort used, and size."""
    first = next(iter(by_model.values()))
    rows = tuple(
        (joint, *(f"{one.percent[k]:.3g} % ({one.rms[k]:.2g})" for one in by_model.values()))
        for k, joint in enumerate((*first.joints, "all joints"))
    )
    return Table(f"{title} [% of the effort used, in brackets {first.unit}]", rows, ("", *by_model))
