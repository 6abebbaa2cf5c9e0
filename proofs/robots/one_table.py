"""One table for nine real robots: zero code, documented facts, `auto`, and a script of fifty lines.

Errors [%] on motion that was not fitted, over the whole log: the mean over joints. "Zero code" is
the robot file that `init` writes, or what `check --fix` makes of it where `identify` refuses it;
"documented" adds the facts of the data's README (gains, signs, gravity, which columns); a robot
with an example has that. `auto` is the same file with
`friction = "auto"`. The script is the consistent estimate's rival: least squares weighted by each
joint's noise, with Coulomb, viscous friction, offset and rotor inertia, as `method =
"least_squares"` gives it from the same file. "Best" is the least error of a few lists of friction
laws that were tried by hand with the same file, the unseen log in view.
"""

import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from proofs.checks.two_faults import run
from proofs.robots.scores import EXAMPLES, identified, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.robot.file.toml_schema import tomllib

Edit = Callable[[str], str]

AUTO = 1.05


@dataclass(frozen=True)
class Case:
    """One robot with its split.

    Attributes:
        name: Name of the robot.
        fit: Logs to fit.
        unseen: The log to predict.
        best: Error of the best configuration that was tried by hand [%].
        shipped: Name of the robot file among the examples; empty if `init` writes it.
        urdf: For `init`.
        facts: Edits of what `init` wrote.
        zero: Bound of zero code [%].
        auto: Bound of `auto` [%], where there is one of its own.
    """

    name: str
    fit: tuple[str, ...]
    unseen: str
    best: float
    shipped: str = ""
    urdf: str = ""
    facts: Edit | None = None
    zero: float | None = None
    auto: float | None = None


def cases() -> Iterator[Case]:
    """All nine robots."""
    data = data_folder()
    yield Case("UR10e", tuple(ur10e_logs()), ur10e_validation(), 6.34, "ur10e", auto=6.0)
    log = data / "panda" / "panda_gaz2019_trajectory1.parquet"
    yield Case("Panda", (f"{log}@0.6:9.5",), f"{log}@9.5:13.8", 4.76, "panda")
    log = data / "rokae_ar5" / "ar5_run1_rows0_2300.parquet"
    yield Case("AR5", (f"{log}@0:34",), f"{log}@34:45", 9.05, "rokae_ar5")
    log = data / "tiago" / "tiago_run1_rows0_5600.parquet"
    yield Case("TIAGo", (f"{log}#921:4443",), f"{log}#4443:5600", 8.57, "tiago")
    log = data / "tx40" / "tx40_run1.parquet"
    yield Case("TX40", (f"{log}@0.1:5.2",), f"{log}@5.2:7.5", 12.25, "tx40", auto=14.2)
    log = data / "ur10" / "ur10_exciting.parquet"
    urdf = str(data / "ur10" / "ur10_robot.urdf")
    yield Case("UR10", (f"{log}@0:18",), f"{log}@18:27", 9.84, urdf=urdf, zero=11.0)
    folder = data / "krang_lwa3"
    fit, unseen = (str(folder / f"krang_lwa3_{part}Data.parquet") for part in ("train", "test"))
    urdf = str(folder / "singlearm.urdf")
    yield Case("LWA3", (fit,), unseen, 10.52, urdf=urdf, facts=_lwa3, zero=13.0)
    log = data / "med7" / "med7_measurements.parquet"
    urdf = str(data / "med7" / "med7dock.urdf")
    window = f"{log}@10.5:16.5"
    yield Case("Med7", (f"{log}@0:10.5",), window, 45.4, urdf=urdf, facts=_med7, zero=8.0)
    folder = data / "kinova_gen3"
    names = (*(f"joint_{k}_trapez" for k in (1, 2, 7)), "Trajectory1")
    logs = tuple(str(folder / f"{name}.parquet") for name in names)
    unseen = str(folder / "RunTrajectory1.parquet")
    urdf = str(folder / "gen3.urdf")
    yield Case("Gen3", logs, unseen, 30.96, urdf=urdf, facts=_gen3)


def _lwa3(text: str) -> str:
    """Published gains, and gravity along the base's -y."""
    gains = "[18.71, 18.71, 23.75, 23.75, 8.83, 8.83, 8.83]"
    text = re.sub(r"(?m)^gain = .*", f"gain = {gains}", text)
    return re.sub(r"(?m)^gravity = .*", "gravity = [0.0, -9.81, 0.0]", text)


def _med7(text: str) -> str:
    """All torques count against the model file."""
    signs = "gain = [-1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]"
    return re.sub(r"(?m)^(columns = .*)", rf"\1\n{signs}", text)


def _gen3(text: str) -> str:
    """The torques of currents; others are computed."""
    return re.sub(r"(?m)^columns = .*", 'columns = "TorqueCur{}"', text)


LAWS = ("coulomb", "viscous", "quadratic", "root")


def with_friction(text: str, friction: str) -> str:
    """The robot file with friction "auto", or with Coulomb and viscous friction of the joints."""
    default = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]
    terms = tomllib.loads(text).get("model", {}).get("terms", default)
    kept = [x for x in terms if not _of_joints(x)]
    kept += [] if friction == "auto" else ["coulomb", "viscous"]
    body = f"[model]\nterms = {_toml(kept)}\n" + 'friction = "auto"\n' * (friction == "auto")
    return re.sub(r"(?ms)^\[model\]\n.*?(?=^\[|\Z)", "", text) + f"\n{body}"


def _of_joints(term: str | Mapping[str, Any]) -> bool:
    """Whether a term is friction of the joints."""
    if isinstance(term, str):
        return term in LAWS
    return term["law"] in LAWS and not {"along", "joints", "motors"} & set(term)


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + "}"
    return (
        "[" + ", ".join(map(_toml, value)) + "]" if isinstance(value, list) else json.dumps(value)
    )


def with_method(text: str, method: str) -> str:
    """The robot file with a method of estimation, and weights by noise."""
    lines = [x for x in text.splitlines() if not x.startswith(("method = ", "weights = "))]
    if "[estimation]" not in lines:
        lines.append("[estimation]")
    lines.insert(lines.index("[estimation]") + 1, f'method = "{method}"')
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Figures:
    """Errors of one robot [%]; `None` where `identify` refused."""

    zero: float | None
    documented: float | None
    auto: float | None
    script: float | None
    mix: str
    pooled: float | None


def figures(case: Case, folder: Path) -> Figures:
    """All configurations of one robot."""

    def error(text: str) -> tuple[float | None, float | None, str]:
        robot = folder / "robot.toml"
        robot.write_text(text, encoding="utf-8")
        try:
            found = identified("", list(case.fit), [case.unseen], file=robot)
        except RuntimeError as refused:
            print(f"{case.name}: {str(refused).strip().splitlines()[0]}", file=sys.stderr)
            return None, None, ""
        log, friction = found["validation"][0], found["friction"]
        mix = str(friction["chosen"]) if friction else ""
        return log["mean_percent"], log["pooled_percent"], mix

    zero = None
    if case.shipped:
        text = (EXAMPLES / f"{case.shipped}.toml").read_text(encoding="utf-8")
    else:
        file = folder / "drafted.toml"
        run("init", case.urdf, case.fit[-1].split("@")[0], "-o", file)
        drafted = file.read_text(encoding="utf-8")
        zero = error(drafted)[0]
        if zero is None:
            run("check", file, *case.fit, "--fix", folder / "fixed.toml")
            fixed = folder / "fixed.toml"
            zero = error(fixed.read_text(encoding="utf-8"))[0] if fixed.exists() else None
        text = case.facts(drafted) if case.facts else drafted
    plain = text if 'friction = "auto"' not in text else with_friction(text, "plain")
    documented, _, _ = error(with_method(plain, "consistent"))
    script, _, _ = error(with_method(plain, "least_squares"))
    auto, pooled, mix = error(with_method(with_friction(text, "auto"), "consistent"))
    return Figures(zero, documented, auto, script, mix, pooled)


def line_of(case: Case, found: Figures) -> str:
    """One row of the table."""
    cells = (found.zero, found.documented, found.auto, found.script, case.best)
    row = "".join(f"{'-' if x is None else f'{x:.2f}':>12}" for x in cells)
    return f"{case.name:<7}{row}  {found.mix}"


def claims_of(case: Case, found: Figures) -> list[Claim]:
    """What is claimed of one robot."""
    claims = []
    if found.documented is not None and found.script is not None:
        claims.append(
            _at_most(f"{case.name}, documented", found.documented, found.script, "script")
        )
    if found.auto is not None:
        claims.append(_at_most(f"{case.name}, auto", found.auto, AUTO * case.best, "1.05 x best"))
    if case.auto is not None and found.auto is not None:
        claims.append(_at_most(f"{case.name}, auto, bound", found.auto, case.auto, "bound"))
    if case.zero is not None:
        zero = float("inf") if found.zero is None else found.zero
        claims.append(_at_most(f"{case.name}, zero code", zero, case.zero, "bound"))
    if case.name == "Panda" and found.pooled is not None:
        claims.append(_at_most("Panda, consistent, pooled", found.pooled, 1.40, "bound"))
    return claims


def _at_most(name: str, value: float, bound: float, what: str) -> Claim:
    return Claim(name, f"{value:.2f} %", f"<= {bound:.2f} % ({what})", value <= bound)


def main() -> list[Claim]:
    """The table, then what is claimed of it."""
    head = ("zero code", "documented", "auto", "script", "best")
    print(f"{'robot':<7}" + "".join(f"{x:>12}" for x in head) + "  laws of auto", file=sys.stderr)
    claims = []
    for case in cases():
        with tempfile.TemporaryDirectory() as folder:
            found = figures(case, Path(folder))
        print(line_of(case, found), file=sys.stderr, flush=True)
        claims += claims_of(case, found)
    return claims


if __name__ == "__main__":
    main_of(main)
