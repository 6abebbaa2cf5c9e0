"""Payloads and drive gains of the UR10e from its real logs, with and without known payloads.

No payload was set in the controller; 2.805 kg and 2.600 kg are what the data's authors state. The
references of the gains are slopes of the controller's own moment over its current at rest.
"""

import json
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.base.progress import silent
from steelyard.estimate.friction.friction_mixes_and_curves import with_any_speed
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
)
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload.drive_gains import Bilinear, GainEstimate, identified_gains
from steelyard.estimate.payload.runs_with_payload import carrier, load_case
from steelyard.model.model import Model, model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.runs.runs_of_named_logs import log_files, prepared, processing_of_robot, recording_of

ROBOT = Path(__file__).parents[2] / "examples" / "ur10e.toml"
PAIR = ("ur-20_02_19_14harm50sec", "ur-20_02_19_14harm50secLoad")
LIGHT_PAIR = ("ur-19_12_23_free", "ur-20_01_13-load_2600")
OTHERS = (
    "ur-20_02_05-20sec_8harm",
    "ur-20_02_05-20sec_12harm",
    "ur-20_02_06-20sec_5harm",
    "ur-20_02_10-20sec_7harm",
    "ur-20_02_10-30sec_12harm",
    "ur-20_02_12-40sec_12harm",
)
EMPTY = ("ur-20_02_19_14harm50sec", "ur-19_12_23_free", "ur-20_01_31-unload")
GAINS = np.array([11.98, 11.98, 9.83, 10.76, 10.76, 10.76])


def log(name: str) -> str:
    """The file of a run."""
    return str(data_folder() / "ur10e" / "identification" / f"{name}.parquet")


def steelyard(*arguments: str) -> dict[str, Any]:
    """What a command says with `--json`."""
    command = [sys.executable, "-m", "steelyard", *arguments, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def weighed(fitted: tuple[str, ...], *carrying: str) -> list[dict[str, Any]]:
    """Payloads of some runs, each against a model identified from other ones."""
    with tempfile.TemporaryDirectory() as folder:
        model = f"{folder}/model"
        steelyard("identify", str(ROBOT), *(log(name) for name in fitted), "-o", model)
        return [steelyard("payload", model, log(name), "--frame", "tool0") for name in carrying]


def _payload(name: str, mass: float, percent: float, found: dict[str, Any]) -> Claim:
    error = 100.0 * (found["mass"] / mass - 1.0)
    figure = f"{found['mass']:.3f} ± {found['mass_half_width']:.3f} kg ({error:+.1f} %)"
    covered = abs(found["mass"] - mass) <= found["mass_half_width"]
    bound = f"{mass} kg within {percent:g} %, in its interval"
    return Claim(name, figure, bound, abs(error) <= percent and covered)


def _empty() -> Claim:
    found = weighed(OTHERS, EMPTY[0], *EMPTY[1:])
    figure = ", ".join(f"{x['mass']:+.3f} ± {x['mass_half_width']:.3f}" for x in found)
    holds = all(abs(x["mass"]) <= min(0.05, x["mass_half_width"]) for x in found)
    bound = "0 ± 0.05 kg, in their intervals"
    return Claim("three unloaded runs weigh", f"{figure} kg", bound, holds)


@cache
def loaded_robot() -> LoadedRobot:
    """The robot file."""
    return load_robot(ROBOT)


@cache
def information_of(pair: tuple[str, str]) -> tuple[Model, Information, Information]:
    """What an unloaded and a loaded run say, efforts as logged."""
    loaded = loaded_robot()
    assert loaded.signals is not None
    regressor = base_regressor(with_any_speed(model_with_open_friction(loaded)))
    files = log_files([log(name) for name in pair])
    recordings = [recording_of(file, loaded.signals) for file in files]
    runs = prepared(recordings, processing_of_robot(loaded), silent)
    unloaded, with_it = (gather(regressor, run) for run in runs)
    return regressor.model, unloaded, with_it


def gains_from(pair: tuple[str, str], mass: float) -> GainEstimate:
    """Gains from an unloaded and a loaded run and the payload's mass, nothing else."""
    model, unloaded, with_it = information_of(pair)
    return identified_gains(model, [unloaded], [with_it], mass=mass, frame="tool0")


def biased_gains(pair: tuple[str, str], mass: float) -> np.ndarray:
    """The same with noisy currents among the regressor's columns, as is customary."""
    model, unloaded, with_it = information_of(pair)
    frame = carrier(model.robot, "tool0")
    case = load_case(
        model, base_parameters(model), frame, [unloaded], [with_it], first_deviates=False
    )
    return 1.0 / Bilinear.of(case, mass, np.full(model.robot.n, np.nan), True).first()


def _gains() -> list[Claim]:
    found = gains_from(PAIR, 2.805)
    error = 100.0 * (found.gains / GAINS - 1.0)
    width = 100.0 * found.half_width / found.gains
    middle = ", ".join(
        f"{g:.2f} ({e:+.1f} %)" for g, e in zip(found.gains[1:4], error[1:4], strict=True)
    )
    every = "  ".join(
        f"{g:.2f} ± {h:.2f}" for g, h in zip(found.gains, found.half_width, strict=True)
    )
    first = f"{found.gains[0]:.2f} ({error[0]:+.1f} %)"
    other, biased = gains_from(LIGHT_PAIR, 2.6).gains[0], biased_gains(PAIR, 2.805)[0]
    return [
        Claim(
            "gains of joints 2 to 4 from 2.805 kg [Nm/A]",
            middle,
            "11.98 9.83 10.76 within 8 %",
            bool(np.all(np.abs(error[1:4]) <= 8.0)),
        ),
        Claim("gain of joint 1", first, "11.98 within 15 %", bool(abs(error[0]) <= 15.0)),
        Claim("its 95 % half-width", f"{width[0]:.1f} %", "<= 20 %", bool(width[0] <= 20.0)),
        Claim(
            "intervals of all six gains",
            every,
            "finite, above zero",
            bool(np.isfinite(width).all() and np.all((width > 0.0) & (width < 100.0))),
        ),
        Claim("gain of joint 1 with currents in the regressor", f"{biased:.2f}", "reported", True),
        Claim(
            "gain of joint 1 from 2.600 kg, two months earlier", f"{other:.2f}", "reported", True
        ),
    ]


def main() -> list[Claim]:
    """Payloads, an empty hand, gains."""
    other = weighed(OTHERS, "ur-20_01_31-load")[0]
    heavy, light = weighed(PAIR[:1], PAIR[1])[0], weighed(LIGHT_PAIR[:1], LIGHT_PAIR[1])[0]
    return [
        _payload("payload of 14harm50secLoad", 2.805, 3.0, heavy),
        _payload("payload of load_2600", 2.6, 6.0, light),
        _payload("payload of 01_31-load, model from six other days", 2.805, 6.0, other),
        _empty(),
        *_gains(),
    ]


if __name__ == "__main__":
    main_of(main)
