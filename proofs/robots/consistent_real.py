"""The consistent estimate on real robots against weighted least squares, on motions not fitted.

Every figure comes from `steelyard identify ... --json` with the shipped robot files; weighted least
squares with `[estimation] method = "least_squares"` and all else alike. Masses are compared with
the vendors' data sheets where these give the moving mass or the arm's weight.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from proofs.robots.scores import file_with, identified, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia


@dataclass(frozen=True)
class Case:
    """One robot.

    Attributes:
        name: Of its robot file.
        fitted: Logs to fit.
        unseen: Logs to predict.
        ratio: Greatest error over that of least squares.
        joints: Joints whose mean counts; all if `None`.
        weight: The vendor's weight of the arm, base and cables included [kg]; `None` if unknown.
    """

    name: str
    fitted: list[str]
    unseen: list[str]
    ratio: float
    joints: slice | None = None
    weight: float | None = None


def cases() -> list[Case]:
    """The robots, split as their data's READMEs say."""
    data = data_folder()
    panda = data / "panda" / "panda_gaz2019_trajectory1.parquet"
    ar5 = data / "rokae_ar5" / "ar5_run1_rows0_2300.parquet"
    tx40 = data / "tx40" / "tx40_run1.parquet"
    return [
        Case("ur10e", ur10e_logs(), [ur10e_validation()], 1.02, weight=33.5),
        Case("panda", [f"{panda}@0.6:9.5"], [f"{panda}@9.5:13.8"], 1.02, weight=17.8),
        Case("tx40", [f"{tx40}@0.1:5.2"], [f"{tx40}@5.2:7.5"], 1.02, weight=27.0),
        Case("rokae_ar5", [f"{ar5}@0:34"], [f"{ar5}@34:45"], 0.95, joints=slice(3)),
    ]


def error_of(result: dict[str, Any], joints: slice | None) -> float:
    """Mean over joints of the relative error [%]."""
    scores = result["validation"][0]["joints"][joints or slice(None)]
    return float(np.mean([score["relative_percent"] for score in scores]))


def bodies_of(model: IdentifiedModel) -> list[Inertia]:
    """The identified bodies."""
    assert model.estimate.standard is not None
    values = model.estimate.standard.parameters
    return [
        Inertia.from_ten([values[f"{name}.{body.name}"] for name in INERTIAL_NAMES])
        for body in model.model.robot.bodies
    ]


def claims_of(case: Case, folder: Path) -> list[Claim]:
    """Error, validity and weight of one robot."""
    plain = identified(
        case.name, case.fitted, case.unseen, file=file_with("least_squares", case.name, folder)
    )
    ours = identified(
        case.name,
        case.fitted,
        case.unseen,
        file=file_with("consistent", case.name, folder),
        output=folder / case.name,
    )
    bodies = bodies_of(load_model(folder / case.name))
    errors = [error_of(result, case.joints) for result in (ours, plain)]
    ratio = errors[0] / errors[1]
    valid = sum(np.linalg.eigvalsh(body.pseudo)[0] > 0.0 for body in bodies)
    mass = sum(body.mass for body in bodies)
    title = f"{case.name}: error {errors[0]:.2f} %, least squares {errors[1]:.2f} %"
    claims = [
        Claim(title, f"{ratio:.3f} times", f"<= {case.ratio} times", ratio <= case.ratio),
        Claim(
            f"{case.name}: physically consistent bodies",
            f"{valid} of {len(bodies)}",
            "all",
            bool(valid == len(bodies)),
        ),
    ]
    bound, holds = "reported", True
    if case.weight is not None:
        low, high = case.weight / 1.5, case.weight * 1.5
        bound, holds = f"{low:.1f} to {high:.1f} kg", low <= mass <= high
    claims.append(Claim(f"{case.name}: mass of the moving links", f"{mass:.1f} kg", bound, holds))
    if case.name == "tx40":
        claims.append(Claim("tx40: error", f"{errors[0]:.2f} %", "<= 15.0 %", errors[0] <= 15.0))
    return claims


def main() -> list[Claim]:
    """All robots."""
    claims = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases():
            claims += claims_of(case, Path(folder))
    return claims


if __name__ == "__main__":
    main_of(main)
