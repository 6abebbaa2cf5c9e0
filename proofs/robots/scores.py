"""Scores on four real robots, on motions that were not fitted, with the shipped robot files.

Every figure comes from `steelyard identify ... --json`, as a user would run it.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

EXAMPLES = Path(__file__).parents[2] / "examples"
UR10E_RUNS = (
    "ur-20_02_05-20sec_8harm",
    "ur-20_02_05-20sec_12harm",
    "ur-20_02_06-20sec_5harm",
    "ur-20_02_10-20sec_7harm",
    "ur-20_02_10-30sec_12harm",
    "ur-20_02_12-40sec_12harm",
    "ur-20_02_19_14harm50sec",
)


def ur10e_logs() -> list[str]:
    """The seven identification runs."""
    folder = data_folder() / "ur10e" / "identification"
    return [str(folder / f"{name}.parquet") for name in UR10E_RUNS]


def ur10e_validation() -> str:
    """The point-to-point run that is never fitted."""
    return str(data_folder() / "ur10e" / "validation" / "ur-20_01_17-ptp_10_points.parquet")


def identified(
    robot: str,
    logs: list[str],
    validation: list[str],
    *,
    file: Path | None = None,
    output: Path | None = None,
) -> dict[str, Any]:
    """What `steelyard identify --json` says, with a shipped robot file or another one."""
    data_folder()
    named = EXAMPLES / f"{robot}.toml" if file is None else file
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "steelyard", "identify", str(named), *logs]
        command += ["--validate", *validation] if validation else []
        command += ["-o", str(output or Path(folder) / "out"), "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def file_with(method: str, name: str, folder: Path) -> Path:
    """The shipped robot file with a method of estimation."""
    text = (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("method = ")]
    if "[estimation]" not in lines:
        lines.append("[estimation]")
    lines.insert(lines.index("[estimation]") + 1, f'method = "{method}"')
    file = folder / f"{name}_{method}.toml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def mix_of(result: dict[str, Any]) -> str:
    """The friction laws that were chosen."""
    return str(result["friction"]["chosen"])


def _ur10e() -> list[Claim]:
    result = identified("ur10e", ur10e_logs(), [ur10e_validation()])
    score = result["validation"][0]
    relative = [joint["relative_percent"] for joint in score["joints"]]
    moving, whole = score["mean_percent_moving"], score["mean_percent"]
    base = [p["name"] for p in result["parameters"]]
    rigid = sum(not n.startswith(("coulomb.", "viscous.", "offset.")) for n in base)
    loads = max(relative[1:3])
    return [
        Claim("UR10e, mean where joints move", f"{moving:.2f} %", "<= 6.0 %", moving <= 6.0),
        Claim("UR10e, mean of the whole log", f"{whole:.2f} %", "<= 16.5 %", whole <= 16.5),
        Claim("UR10e, joints 2 and 3, whole log", f"{loads:.2f} %", "<= 4.5 %", loads <= 4.5),
        Claim("UR10e, base parameters with rotor inertia", f"{rigid}", "40", rigid == 40),
    ]


def _ur10e_auto() -> list[Claim]:
    """The row of README's table below that."""
    result = identified("ur10e_auto", ur10e_logs(), [ur10e_validation()])["validation"][0]
    moving, whole = result["mean_percent_moving"], result["mean_percent"]
    figure = f"{moving:.1f} % and {whole:.1f} %"
    holds = moving <= 4.2 and whole <= 6.4
    return [
        Claim("UR10e, auto, where joints move and whole log", figure, "<= 4.2 and 6.4 %", holds)
    ]


def _panda() -> list[Claim]:
    log = str(data_folder() / "panda" / "panda_gaz2019_trajectory1.parquet")
    result = identified("panda", [f"{log}@0.6:9.5"], [f"{log}@9.5:13.8"])
    pooled = result["validation"][0]["pooled_percent"]
    base = [p["name"] for p in result["parameters"]]
    laws = ("coulomb", "viscous.", "offset.", "dahl.", "lugre", "maxwell", "stribeck.")
    rigid = sum(not n.startswith((*laws, "root.", "quadratic.", "cubic.")) for n in base)
    return [
        Claim(f"Panda, pooled ({mix_of(result)})", f"{pooled:.3f} %", "<= 1.55 %", pooled <= 1.55),
        Claim("Panda, base parameters", f"{rigid}", "43", rigid == 43),
    ]


def _ar5() -> list[Claim]:
    log = str(data_folder() / "rokae_ar5" / "ar5_run1_rows0_2300.parquet")
    result = identified("rokae_ar5", [f"{log}@0:34"], [f"{log}@34:45"])
    rmse = np.array([joint["rmse"] for joint in result["validation"][0]["joints"]])
    bound = np.array([0.36, 0.46, 0.15, 0.20, 0.07, 0.08, 0.025])
    return [_each("AR5, RMSE per joint", rmse, bound, "Nm")]


def _tiago() -> list[Claim]:
    log = str(data_folder() / "tiago" / "tiago_run1_rows0_5600.parquet")
    result = identified("tiago", [f"{log}#921:4443"], [f"{log}#4443:5600"])
    amperes = np.array([joint["rmse"] for joint in result["validation"][0]["joints"][1:]])
    rmse = amperes * [13.6, 13.6, 8.7, 8.7]
    bound = 1.1 * np.array([0.66, 1.02, 0.47, 0.57])
    return [_each("TIAGo, RMSE of arm joints 1 to 4", rmse, bound, "Nm")]


def _each(name: str, values: np.ndarray, bounds: np.ndarray, unit: str) -> Claim:
    figure = " ".join(f"{v:.3f}" for v in values)
    bound = " ".join(f"{b:.3f}" for b in bounds)
    return Claim(name, f"{figure} {unit}", f"<= {bound}", bool(np.all(values <= bounds)))


def _rigid_ur10e() -> Claim:
    from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
    from steelyard.model.laws.laws_without_friction import RigidBody
    from steelyard.model.model import Model
    from steelyard.robot.file.robot_file import load_robot

    data_folder()
    count = len(base_parameters(Model(load_robot(EXAMPLES / "ur10e.toml").robot, (RigidBody(),))))
    return Claim("UR10e, base parameters of the bodies alone", f"{count}", "36", count == 36)


def main() -> list[Claim]:
    """All four robots."""
    return [*_ur10e(), *_ur10e_auto(), _rigid_ur10e(), *_panda(), *_ar5(), *_tiago()]


if __name__ == "__main__":
    main_of(main)
