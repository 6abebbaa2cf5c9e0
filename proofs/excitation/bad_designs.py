"""Designs that cannot be: the message, and that the smallest change that it advises works.

The Panda of `problems/panda.toml` with one requirement that allows no motion. The message's
change is applied word for word, and the design made anew: it must be proven for all times.
"""

import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from proofs.support.claims import Claim, data_folder, main_of

from steelyard.base.errors import SteelyardError

HEAD = """
[robot]
urdf = "${STEELYARD_DATA}/../models/panda_description/urdf/panda.urdf"
locked = { panda_finger_joint1 = 0.0 }
[model]
terms = ["rigid_body", "viscous", "coulomb"]
"""
LIMITS = """
[excitation.limits]
effort = "any"
acceleration = 7.5
"""
FREE = """
[excitation.collision]
bodies = false
"""
BOX = """
[excitation.workspace]
frame = "panda_hand_tcp"
"""


def number(pattern: str) -> Callable[[SteelyardError], str]:
    """What the advice has in the place of the pattern's group."""
    return lambda error: re.findall(pattern, error.fix)[0]


@dataclass(frozen=True)
class Case:
    """A design that cannot be.

    Attributes:
        name: What is wrong.
        tables: The robot file after its head; `{}` is what is wrong in it.
        wrong: What stands there.
        words: What the message must say.
        corrected: What the message would have there.
    """

    name: str
    tables: str
    wrong: str
    words: tuple[str, ...]
    corrected: Callable[[SteelyardError], str]


CASES = (
    Case(
        "limits that allow no motion",
        f"{LIMITS}position_margin = {{}}\n{FREE}",
        "1.6",
        ("panda_joint4", "nothing remains with a margin of 1.6 rad"),
        lambda e: str(0.99 * float(re.findall(r"below ([\d.]+)", e.fix)[0])),
    ),
    Case(
        "speeds that allow no motion",
        f"{FREE}{LIMITS}velocity = 0.001\n[excitation.motion]\nperiod = {{}}\n",
        "10.0",
        ("too short for 5 harmonics", "no joint can move by even 0.002 rad"),
        number(r"period = ([\d.]+)"),
    ),
    Case(
        "a start posture in collision",
        f"{LIMITS}[excitation.motion]\nstart = {{}}\n",
        "[0.0, 1.6, 0.0, -2.9, 0.0, 0.2, 0.0]",
        ("the start posture violates: distance of", "violated by"),
        number(r"\[.*\]"),
    ),
    Case(
        "a start posture outside limits",
        f"{LIMITS}{FREE}[excitation.motion]\nstart = [0.0, 0.0, 0.0, {{}}, 0.0, 1.5, 0.0]\n",
        "0.1",
        ("'panda_joint4' at 0.1 rad", "above its upper limit"),
        number(r"and (-?[\d.]+) rad"),
    ),
    Case(
        "a box out of reach",
        f"{LIMITS}{FREE}{BOX}box = {{z = [{{}}, 3.0]}}\n",
        "1.5",
        ("no posture was found", "z of 'panda_hand_tcp' above 1.5 m", "violated by"),
        lambda e: str(1.5 - float(re.findall(r"by ([\d.]+) m, or more", e.fix)[0])),
    ),
    Case(
        "a period too short for the harmonics",
        f"{LIMITS}{FREE}[excitation.motion]\nharmonics = 8\nperiod = {{}}\n",
        "0.3",
        ("a period of 0.3 s is too short for 8 harmonics",),
        number(r"period = ([\d.]+)"),
    ),
    Case(
        "ends too far apart for the time",
        f"{LIMITS}{FREE}[excitation.motion]\nstart = [-2.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0]\n"
        "end = [2.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0]\nperiod = {}\n",
        "1.0",
        ("from the start to the end posture within the limits takes", "the motion has 1 s"),
        number(r"more than ([\d.]+) s"),
    ),
)


def designed(tables: str, folder: Path) -> tuple[float, bool]:
    """Figure of the best motion of one search, and whether all is proven."""
    from steelyard.excite.search.parallel_search import SearchBudget
    from steelyard.excite.searched_or_planned_motion import design
    from steelyard.model.model import model_with_open_friction
    from steelyard.robot.file.robot_file import load_robot

    path = folder / "panda.toml"
    path.write_text(HEAD + tables, encoding="utf-8")
    loaded = load_robot(path)
    found = design((loaded, model_with_open_friction(loaded), None), SearchBudget(60.0, searches=1))
    return found.shown.criterion_value, found.certificate.holds


def of(case: Case, folder: Path) -> list[Claim]:
    """The message, and the design with the change that it advises."""
    try:
        designed(case.tables.replace("{}", case.wrong), folder)
    except SteelyardError as error:
        refusal = error
    else:
        return [Claim(case.name, "designed all the same", "refused", False)]
    print(f"{case.name}\n  {refusal}\n")
    missing = [word for word in case.words if word not in str(refusal)]
    claim = Claim(
        f"{case.name}: message",
        f"missing: {missing}" if missing else f"{refusal.wrong[:70]} ...",
        "what, by how much",
        not missing,
    )
    try:
        figure, proven = designed(case.tables.replace("{}", case.corrected(refusal)), folder)
    except (SteelyardError, IndexError) as error:
        return [claim, Claim(f"{case.name}: advice", str(error)[:90], "works", False)]
    words = f"figure {figure:.3g}, {'proven' if proven else 'not proven'}"
    return [claim, Claim(f"{case.name}: advice", words, "works, proven", proven)]


def main() -> list[Claim]:
    """All of them."""
    data_folder()
    with tempfile.TemporaryDirectory() as folder:
        return [claim for case in CASES for claim in of(case, Path(folder))]


if __name__ == "__main__":
    main_of(main)
