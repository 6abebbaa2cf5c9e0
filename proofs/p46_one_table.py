"""One table for all robots: zero code, documented facts, `auto`, and a script of fifty lines.

Errors [%] on motion that was not fitted, over the whole log: the mean over joints, and pooled.
"Zero code" is the robot file that `init` writes, with what `check --fix` proposes where a row says
so; "documented" adds the facts of the data's README. The script is Pinocchio's regressor with
Coulomb, viscous friction, offset and rotor inertia, and least squares weighted by each joint's
noise.
"""

import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from claims import data_folder
from p02_scores import EXAMPLES, identified, ur10e_logs, ur10e_validation
from p42_two_faults import run

Edit = Callable[[str], str]


@dataclass(frozen=True)
class Case:
    """One robot with its split.

    Attributes:
        name: Name of the robot.
        fit: Logs to fit.
        unseen: The log to predict.
        shipped: Name of the robot file among the examples; empty if `init` writes it.
        urdf: For `init`.
        facts: Edits of what `init` wrote, of the data's README.
    """

    name: str
    fit: tuple[str, ...]
    unseen: str
    shipped: str = ""
    urdf: str = ""
    facts: Edit | None = None


def cases() -> Iterator[Case]:
    """All nine robots."""
    data = data_folder()
    yield Case("UR10e", tuple(ur10e_logs()), ur10e_validation(), "ur10e")
    log = data / "panda" / "panda_gaz2019_trajectory1.parquet"
    yield Case("Panda", (f"{log}@0.6:9.5",), f"{log}@9.5:13.8", "panda")
    log = data / "rokae_ar5" / "ar5_run1_rows0_2300.parquet"
    yield Case("AR5", (f"{log}@0:34",), f"{log}@34:45", "rokae_ar5")
    log = data / "tiago" / "tiago_run1_rows0_5600.parquet"
    yield Case("TIAGo", (f"{log}#921:4443",), f"{log}#4443:5600", "tiago")
    log = data / "tx40" / "tx40_run1.parquet"
    yield Case("TX40", (f"{log}@0.1:5.2",), f"{log}@5.2:7.5", "tx40")
    log = data / "ur10" / "ur10_exciting.parquet"
    urdf = str(data / "ur10" / "ur10_robot.urdf")
    yield Case("UR10", (f"{log}@0:18",), f"{log}@18:27", urdf=urdf)
    folder = data / "krang_lwa3"
    fit, unseen = (str(folder / f"krang_lwa3_{part}Data.parquet") for part in ("train", "test"))
    yield Case("LWA3", (fit,), unseen, urdf=str(folder / "singlearm.urdf"), facts=_lwa3)
    log = data / "med7" / "med7_measurements.parquet"
    urdf = str(data / "med7" / "med7dock.urdf")
    yield Case("Med7", (f"{log}@0:10.5",), f"{log}@10.5:16.5", urdf=urdf, facts=_med7)
    folder = data / "kinova_gen3"
    logs = [folder / f"{name}.parquet" for name in (*_trapezes(), "Trajectory1")]
    unseen = str(folder / "RunTrajectory1.parquet")
    yield Case("Gen3", tuple(map(str, logs)), unseen, urdf=str(folder / "gen3.urdf"), facts=_gen3)


def _trapezes() -> list[str]:
    return [f"joint_{k}_trapez" for k in (1, 2, 7)]


def _lwa3(text: str) -> str:
    gains = "[18.71, 18.71, 23.75, 23.75, 8.83, 8.83, 8.83]"
    text = re.sub(r"(?m)^gain = .*", f"gain = {gains}", text)
    return re.sub(r"(?m)^gravity = .*", "gravity = [0.0, -9.81, 0.0]", text)


def _med7(text: str) -> str:
    return re.sub(r"(?m)^(columns = .*)", r"\1\ngain = [-1, -1, -1, -1, -1, -1, -1]", text)


def _gen3(text: str) -> str:
    return re.sub(r'(?m)^columns = .*', 'columns = "TorqueCur{}"', text)


def with_friction(text: str, laws: str) -> str:
    """The robot file with other friction laws."""
    text = re.sub(r'(?m)^friction = .*\n', "", text)
    text = re.sub(r'(?ms)^terms = \[.*?\]$\n', "", text)
    return text.replace("[model]", f"[model]\n{laws}") if "[model]" in text else f"{text}\n[model]\n{laws}\n"


def with_method(text: str, method: str) -> str:
    lines = [x for x in text.splitlines() if not x.startswith("method = ")]
    if "[estimation]" not in lines:
        lines.append("[estimation]")
    lines.insert(lines.index("[estimation]") + 1, f'method = "{method}"')
    return "\n".join(lines) + "\n"


def figures(case: Case, text: str, folder: Path) -> dict:
    robot = folder / "robot.toml"
    robot.write_text(text)
    try:
        result = identified("", list(case.fit), [case.unseen], file=robot)
    except RuntimeError as error:
        return {"error": str(error).strip().splitlines()[-3:]}
    log = result["validation"][0]
    choice = result.get("friction")
    return {
        "mean": log["mean_percent"], "pooled": log["pooled_percent"],
        "moving": log["mean_percent_moving"],
        "joints": [round(j["relative_percent"], 2) for j in log["joints"]],
        "mix": choice["chosen"] if choice else "",
        "notes": [n for n in result.get("notes", []) if "raise chi" in n],
    }


def main(names: list[str]) -> None:
    out = {}
    for case in cases():
        if names and case.name not in names:
            continue
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            if case.shipped:
                text = (EXAMPLES / f"{case.shipped}.toml").read_text()
            else:
                file = folder / "drafted.toml"
                run("init", case.urdf, case.fit[-1].split("@")[0], "-o", file)
                text = file.read_text()
                if case.facts:
                    text = case.facts(text)
            auto = with_friction(text, 'friction = "auto"')
            for method in ("consistent", "least_squares"):
                for laws, source in (("plain", text), ("auto", auto)):
                    if laws == "plain" and 'friction = "auto"' in text:
                        source = with_friction(text, 'terms = ["rigid_body", "coulomb", "viscous", "offset"]')
                    if laws == "auto" and 'friction = "auto"' in text:
                        source = text
                    found = figures(case, with_method(source, method), folder)
                    print(case.name, method, laws, json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
