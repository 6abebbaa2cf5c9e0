"""Causes of torque that cannot be: each gets one message that names what is wrong and the correct.

Transmission, loops, springs, twins, effort kinds and gains as users would write them; sums of
unequal information from Python.
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

sys.path.append(str(Path(__file__).parents[2] / "tests"))

from cli.mistakes import Mistake, faults  # noqa: E402

URDF = """<robot name="bars">
  <link name="base"/>{links}{joints}
</robot>"""
LINK = """
  <link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>"""
JOINT = """
  <joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
    <origin xyz="{3} 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="100" velocity="5"/></joint>"""
SIGNALS = """
[signals]
time = "t"
position = "q{}"

[signals.effort]
columns = "tau{}"
kind = "joint_torque"
unit = "Nm"
"""
LOOPS = """
[robot]
urdf = "bars.urdf"
joints = ["j1", "j2"]
passive = ["j3", "j4"]
OPEN
[[robot.loops]]
name = "tip"
links = ["l3", "l4"]
points = [[0.3, 0.0, 0.0], [0.3, 0.0, 0.0]]

[robot.assembly]
j1 = 2.0
j2 = 1.0
j3 = -1.0
j4 = 1.0
"""
TREE = '\n[robot]\nurdf = "bars.urdf"\njoints = ["j1", "j2"]\n'


def transmission(matrix: str) -> str:
    """A robot file with gears."""
    return f"{TREE}\n[robot.transmission]\n{matrix}\n{SIGNALS}"


def terms(text: str) -> str:
    """A robot file with a list of terms."""
    return f"{TREE}\n[model]\nterms = [{text}]\n{SIGNALS}"


CURRENT = SIGNALS.replace("joint_torque", "motor_current").replace('"Nm"', '"A"')
LINK_SIDE = SIGNALS.replace("joint_torque", "link_torque")
POINTLESS = '{law = "gravity_compensator", name = "s", links = ["base", "l1"]}'
LOG = "../given/far.csv"

FILES: dict[str, tuple[str, tuple[str, ...]]] = {
    "idle motor": (
        transmission("matrix = [[30.0, 0.0], [0.0, 0.0]]"),
        ("cannot be inverted", "motor_2", "turns no joint"),
    ),
    "two motors alike": (
        transmission("matrix = [[30.0, 15.0], [60.0, 30.0]]"),
        ("cannot be inverted", "motor_1, motor_2", "same combinations"),
    ),
    "motors' signals without gears": (
        TREE + SIGNALS.replace('position = "q{}"', 'coordinates = "motor"\nposition = "q{}"'),
        ("no transmission", "[robot.transmission]"),
    ),
    "loop that opens in the log": (
        LOOPS.replace("OPEN", "") + SIGNALS,
        ("'tip'", " s", " m", 'open_loops = "drop"'),
    ),
    "spring without its points": (terms(f'"rigid_body", {POINTLESS}'), ("points", "fix")),
    "spring on an unknown link": (
        terms(
            '"rigid_body", {law = "gravity_compensator", name = "s", links = ["base", "l9"], '
            "points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]}"
        ),
        ("'l9'", "did you mean 'l"),
    ),
    "two terms that are one": (
        terms('"rigid_body", "offset", {law = "spring", free = "unknown"}'),
        ("'spring_preload.j1'", "'offset.j1'", "not distinguishable", "leave one"),
    ),
    "three terms of which two suffice": (
        terms('"rigid_body", "coulomb", "offset", "directional_coulomb"'),
        ("directional_coulomb", "coulomb.j1", "leave one"),
    ),
    "friction listed and to be chosen": (
        terms('"rigid_body", "coulomb"').replace("[model]", '[model]\nfriction = "auto"'),
        ("'coulomb' is listed", "leave friction laws"),
    ),
    "rotor on the link side": (
        terms('"rigid_body", "rotor_inertia"').replace(SIGNALS, LINK_SIDE),
        ("rotor_inertia", "link torques", "on the link side"),
    ),
    "current without gain": (TREE + CURRENT, ("no drive gain", "identify")),
    "gain to be identified from nothing": (
        TREE + CURRENT + 'gain = "identify"\n',
        ("scale", "fix"),
    ),
    "field that cannot be found": (
        terms('"rigid_body", {law = "maxwell_slip", lengths = "find"}'),
        ("'lengths'", "cannot be found"),
    ),
    "exponent that is no law": (
        terms('"rigid_body", {law = "stribeck", exponent = 3}'),
        ("exponent", "1", "2"),
    ),
}


@dataclass(frozen=True)
class Workshop:
    """A folder with robot files, and one to work in."""

    given: Path
    work: Path


def workshop(folder: Path) -> Workshop:
    """Files of all mistakes, and a log whose motion reaches too far for the loop."""
    given, work = folder / "given", folder / "work"
    given.mkdir()
    work.mkdir()
    names = ("l1", "l2", "l3", "l4")
    joints = (
        JOINT.format("j1", "base", "l1", "0"),
        JOINT.format("j2", "base", "l2", "0.2"),
        JOINT.format("j3", "l1", "l3", "0.25"),
        JOINT.format("j4", "l2", "l4", "0.25"),
    )
    urdf = URDF.format(links="".join(map(LINK.format, names)), joints="".join(joints))
    (given / "bars.urdf").write_text(urdf)
    for name, (text, _) in FILES.items():
        (given / f"{name}.toml").write_text(text)
    t = np.arange(0.0, 12.0, 0.01)
    q1, q2 = 2.0 + 1.1 * np.sin(2.0 * t), 1.0 - 1.1 * np.sin(2.0 * t)
    noise = np.random.default_rng(0).normal(size=(2, len(t)))
    table = np.column_stack([t, q1, q2, *noise])
    np.savetxt(given / "far.csv", table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="")
    return Workshop(given, work)


def of_file(name: str, place: Workshop) -> Claim:
    """`identify` with one wrong robot file."""
    arguments = ("identify", f"../given/{name}.toml", LOG)
    done = subprocess.run(
        [sys.executable, "-m", "steelyard", *arguments],
        cwd=place.work,
        capture_output=True,
        text=True,
    )
    mistake = Mistake(name, arguments, FILES[name][1])
    wrong = faults(mistake, done.returncode, done.stdout, done.stderr, place.work)
    message = next(
        (line for line in done.stderr.splitlines() if line.startswith("error:")), "nothing"
    )
    figure = "; ".join(wrong) or message.removeprefix("error: ")[:70]
    return Claim(name, figure, "message, exit code 2, nothing left", not wrong)


def of_dropped(place: Workshop) -> list[Claim]:
    """The same loop with `open_loops = "drop"`: fit and score go on and say what they left out."""
    text = FILES["loop that opens in the log"][0].replace("[[robot.l", "X\n[[robot.l", 1)
    text = text.replace("X\n", 'open_loops = "drop"\n')
    (place.given / "drop.toml").write_text(text)
    command = ["identify", "../given/drop.toml", LOG, "-o", "dropped", "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "steelyard", *command],
        cwd=place.work,
        capture_output=True,
        text=True,
    )
    # a poor verdict has an exit code of its own
    notes = json.loads(done.stdout)["notes"] if done.stdout else [done.stderr[-200:]]
    found_note = next((note for note in notes if "does not close" in note), notes[0])
    dropped = "samples left out" in found_note
    scored = subprocess.run(
        [sys.executable, "-m", "steelyard", "validate", "dropped", LOG],
        cwd=place.work,
        capture_output=True,
        text=True,
    )
    shown = " ".join(scored.stdout.split())
    again = "does not close from" in shown and "samples left out" in shown
    bound = "time, gap and samples left out"
    return [
        Claim("open loop, dropped in the fit", found_note[:90], bound, dropped),
        Claim("open loop, dropped in the score", f"exit {scored.returncode}", bound, again),
    ]


def of_information() -> list[Claim]:
    """Information of unequal models or filters is not added."""
    from invented import single
    from steelyard.base.errors import DataError
    from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
    from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
    from steelyard.estimate.information.information import Information, Signature, Window
    from steelyard.model.laws.friction_with_memory import Dahl
    from steelyard.model.laws.register import DEFAULT_TERMS
    from steelyard.model.model import Model

    def information_of(model: Model, filters: str) -> Information:
        regressor = base_regressor(model)
        q, dq, ddq, effort = np.random.default_rng(0).normal(size=(4, 1, 64))
        channels = model.scan()(q, dq, ddq)
        sums = Accumulator(regressor)(Stretch(q, dq, ddq, effort, channels=channels))
        signature = Signature(model.fingerprint, regressor.layout.columns, ("Nm",), filters)
        pieces = (x[None] for x in (sums.grams, sums.absolute, sums.counts))
        return Information(regressor.layout, signature, (Window("run", 0.0, 1.0),), *pieces)

    plain = information_of(Model(single(), DEFAULT_TERMS), "matched 5 Hz")
    short, long = (
        information_of(Model(single(), (*DEFAULT_TERMS, Dahl(length=length))), "matched 5 Hz")
        for length in (1e-3, 2e-3)
    )
    cases = {
        "information of unequal filters": (
            plain,
            information_of(Model(single()), "matched 8 Hz"),
            "filter",
        ),
        "information of unequal models": (plain, short, "model"),
        "information of unequal fields": (short, long, "model"),
    }
    claims = []
    for name, (one, other, word) in cases.items():
        try:
            one + other
        except DataError as error:
            claims.append(Claim(name, str(error)[:70], f"'{word}'", word in str(error)))
        else:
            claims.append(Claim(name, "was added", "an error", False))
    return claims


def main() -> list[Claim]:
    """All of them."""
    with tempfile.TemporaryDirectory() as folder:
        place = workshop(Path(folder))
        claims = [of_file(name, place) for name in FILES]
        return [*claims, *of_dropped(place), *of_information()]


if __name__ == "__main__":
    main_of(main)
