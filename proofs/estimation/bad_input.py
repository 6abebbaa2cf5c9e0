"""Bad input to the consistent estimate: floored, refused or marked, with a note.

Priors that no body can have, constraints that contradict each other, too few samples, a joint that
never moved, and a solver that stops early.
"""

import csv
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

sys.path.append(str(Path(__file__).parents[2] / "tests"))

from cli.mistakes import leftovers  # noqa: E402

LOG = "../given/identification.csv"
FOREARM = (
    '<inertia ixx="0.0155" ixy="0.0001" ixz="0.0005" iyy="0.0150" iyz="-0.0006" izz="0.0024"/>'
)
LOCKED = "forearm_roll"

PRIORS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "prior that breaks the triangle inequality": (
        re.escape(FOREARM),
        FOREARM.replace('izz="0.0024"', 'izz="0.0424"'),
        ("prior of link 'forearm'", "triangle inequality", "raised to"),
    ),
    "prior with a negative moment": (
        re.escape(FOREARM),
        FOREARM.replace('izz="0.0024"', 'izz="-0.0024"'),
        ("prior of link 'forearm'", "negative", "raised to"),
    ),
    "prior without moments": (
        re.escape(FOREARM),
        re.sub('"[^"]+"', '"0"', FOREARM),
        ("prior of link 'forearm'", "moments of inertia are zero", "a solid sphere of 1.9 kg"),
    ),
    "prior without mass": (
        re.escape('<mass value="0.8"/>'),
        '<mass value="0"/>',
        ("prior of link 'hand'", "mass is zero", "is assumed"),
    ),
    "no inertials at all": (
        r"(?s)<inertial>.*?</inertial>",
        "",
        ("prior of links 'turret'", "'hand'", "gives no mass properties", "is assumed"),
    ),
}
"""What is replaced in the model file, by what, and what the notes must say."""

KNOWN = "\n[[knowledge]]\nkind = "
MASS = f'{KNOWN}"mass"\nlink = "forearm"\n'
TOTAL = f'{KNOWN}"total_mass"\n'
REFUSED: dict[str, tuple[str, tuple[str, ...]]] = {
    "two masses that contradict each other": (
        f"{MASS}lower = 4.0\n{TOTAL}upper = 3.0\n",
        (
            "are infeasible together",
            "'forearm'",
            "at least 4 kg",
            "at most 3 kg",
            "[knowledge[1]]",
            "[knowledge[2]]",
            ", line ",
        ),
    ),
    "a constraint that contradicts itself": (
        f"{MASS}lower = 3.0\nupper = 2.0\n",
        ("lower", "upper"),
    ),
    "a body that cannot be": (
        f'{MASS}value = 2.0\n{KNOWN}"centre_in_box"\nlink = "forearm"\nlower = [0.9, 0.0, 0.0]\n'
        f'upper = [1.0, 0.1, 0.1]\n{KNOWN}"parameter"\nparameter = "Izz.forearm"\nupper = 0.1\n',
        ("are infeasible together", "'forearm'", "Izz.forearm"),
    ),
    "bounds that contradict a law's": (
        f'{KNOWN}"parameter"\nparameter = "viscous.elbow"\nupper = -1.0\n',
        ("viscous.elbow",),
    ),
    "a link that is not there": (
        f'{KNOWN}"mass"\nlink = "forarm"\nvalue = 2.0\n',
        ("forarm", "did you mean 'forearm'"),
    ),
    "too few samples": (
        "\n[processing]\nmotion_cutoff = 4.0\nmatched_cutoff = 1.2\n",
        ("too few samples", "parameters", "log longer"),
    ),
}
"""Lines added to the robot file, and what the message must say."""


def ran(arguments: Sequence[str], work: Path) -> subprocess.CompletedProcess[str]:
    """One command, as a user would run it."""
    command = [sys.executable, "-m", "steelyard", *arguments]
    return subprocess.run(command, cwd=work, capture_output=True, text=True)


def robot_of(name: str, given: Path, urdf: str | None = None, added: str = "") -> str:
    """A robot file beside the demo arm's, with another model file or with lines added."""
    slug = name.replace(" ", "_")
    text = (given / "demo_arm.toml").read_text() + added
    if urdf is not None:
        (given / f"{slug}.urdf").write_text(urdf)
        text = text.replace("demo_arm.urdf", f"{slug}.urdf")
    (given / f"{slug}.toml").write_text(text)
    return f"../given/{slug}.toml"


def of_prior(name: str, given: Path, work: Path) -> list[Claim]:
    """A prior that no body can have is named, corrected, and every body of the result can exist."""
    from steelyard.estimate.identified_model import load_model
    from steelyard.estimate.prior.body_priors import default_knowledge
    from steelyard.estimate.scores.estimator_comparison import impossible_bodies

    old, new, words = PRIORS[name]
    urdf = re.sub(old, new, (given / "demo_arm.urdf").read_text())
    robot = robot_of(name, given, urdf)
    out = work.parent / name.replace(" ", "_")
    done = ran(("identify", robot, LOG, "--json", "-o", str(out)), work)
    if done.returncode:
        return [Claim(name, done.stderr[:90], "a fit and a note", False)]
    notes = json.loads(done.stdout)["notes"]
    link = words[0].split(" ")[-1]
    about = "; ".join(note for note in notes if link in note)
    lacking = [word for word in words if word not in about]
    identified = load_model(out)
    impossible = impossible_bodies(identified.estimate, default_knowledge(identified.model))
    count = "bodies not stated" if impossible is None else f"{len(impossible)} bodies cannot exist"
    return [
        Claim(
            f"{name}: noted",
            f"lacks {', '.join(lacking)}" if lacking else about[:90],
            f"link named, {words[-1]}",
            not lacking,
        ),
        Claim(f"{name}: bodies", count, "all valid", impossible == ()),
    ]


def of_refusal(name: str, given: Path, work: Path) -> Claim:
    """A robot file that cannot be served: one message, exit code 2, nothing left."""
    added, words = REFUSED[name]
    done = ran(("identify", robot_of(name, given, added=added), LOG), work)
    text = " ".join(done.stderr.split())
    wrong = [f"lacks {word!r}" for word in words if word not in text]
    wrong += [] if done.returncode == 2 else [f"exit code {done.returncode}"]
    wrong += ["shows a traceback"] if "Traceback" in done.stderr else []
    wrong += [f"leaves {left}" for left in leftovers(work)]
    shape = [line.split()[0] for line in done.stderr.splitlines() if line.split()]
    wrong += [] if shape[:1] == ["error:"] and shape[-2:] == ["where", "fix"] else ["is no message"]
    figure = f"{'; '.join(wrong)}: {text[:90]}" if wrong else text.removeprefix("error: ")[:90]
    return Claim(name, figure, "named, exit code 2, nothing left", not wrong)


def resting_log(given: Path) -> None:
    """A log of the nominal arm in which one joint rests, loaded by the motion of the others."""
    from steelyard.base.arrays import Parameters
    from steelyard.base.motion import Motion
    from steelyard.excite.trajectories.fourier import random_fourier
    from steelyard.logs.formats import write_table
    from steelyard.model.laws.register import term_of
    from steelyard.model.model import Model
    from steelyard.robot.file.robot_file import load_robot

    loaded = load_robot(given / "demo_arm.toml")
    model = Model(loaded.robot, tuple(term_of(t.description, t.where) for t in loaded.terms or ()))
    truth = [0.4 if p.prior is None else p.prior for p in model.parameters]
    valued = model.at(Parameters(model.names, model.units, truth))
    rest = model.robot.joint_names.index(LOCKED)
    motion = random_fourier(loaded.robot, seed=4, period=20.0)
    t = np.arange(0.0, 20.0, 0.004)
    whole = motion.sample(t)
    q, dq, ddq = (x.copy() for x in (whole.q, whole.dq, whole.ddq))
    q[:, rest], dq[:, rest], ddq[:, rest] = 0.3, 0.0, 0.0
    tau = valued.torque(Motion(t, q, dq, ddq))
    tau = tau + 0.02 * tau.std(axis=0) * np.random.default_rng(0).normal(size=tau.shape)
    columns = {"time_s": t}
    for k in range(model.robot.n):
        columns |= {f"q{k + 1}_rad": q[:, k], f"dq{k + 1}_rad_s": dq[:, k]}
        columns |= {f"tau{k + 1}_Nm": tau[:, k]}
    write_table(given / "resting.parquet", columns)


def of_rest(given: Path, work: Path) -> list[Claim]:
    """What only a joint's own motion shows comes from the prior, and is marked so."""
    from steelyard.estimate.identified_model import load_model

    resting_log(given)
    out = work.parent / "rested"
    log = "../given/resting.parquet"
    done = ran(("identify", "../given/demo_arm.toml", log, "--no-check", "-o", str(out)), work)
    if done.returncode:
        return [Claim("a joint that never moved", done.stderr[:90], "a fit", False)]
    with (out / "parameters.csv").open() as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    own = [name for name in rows if name in (f"viscous.{LOCKED}", f"coulomb.{LOCKED}")]
    marks = {name: rows[name]["status"] for name in own}
    standard = load_model(out).estimate.standard
    assert standard is not None
    shares = dict(zip(standard.parameters.names, 100.0 * standard.learned, strict=True))
    stds = dict(zip(standard.parameters.names, standard.std, strict=True))
    learned = [shares[name] for name in own]
    others = [share for name, share in shares.items() if name.startswith("viscous.")]
    others = [share for share in others if share not in learned]
    seen = "; ".join(f"{name}: {mark}" for name, mark in marks.items())
    page = (out / "report.html").read_text()
    unseen = page[page.index('<section id="unseen"') :]
    named = [name for name in own if name in unseen[: unseen.index("</section>")]]
    return [
        Claim(
            "a joint that never moved: its friction",
            seen or "not listed",
            "not called identified",
            len(own) == 2
            and all(mark in ("from the prior", "not identifiable") for mark in marks.values()),
        ),
        Claim(
            "a joint that never moved: share from data",
            f"{max(learned, default=-1.0):.2g} %; other joints at least {min(others):.3g} %",
            "<= 1 %; >= 80 %",
            max(learned, default=100.0) <= 1.0 and min(others) >= 80.0,
        ),
        Claim(
            "a joint that never moved: standard deviations of its friction",
            f"at least {min((stds[name] for name in own), default=0.0):.3g} Nm, Nm s/rad",
            ">= 10",
            min((stds[name] for name in own), default=0.0) >= 10.0,
        ),
        Claim(
            "a joint that never moved: report",
            f"{len(named)} of {len(own)} among what could not be seen",
            "both",
            len(named) == 2,
        ),
    ]


def of_solver(given: Path) -> list[Claim]:
    """Whatever number of iterations: the optimum, or an error that says it is none."""
    from steelyard.base.errors import SteelyardError
    from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import Unsolved
    from steelyard.estimate.consistent.convex_estimator import Consistent
    from steelyard.estimate.information.base_parameters_and_regressor import (
        base_parameters,
        base_regressor,
    )
    from steelyard.estimate.information.gather import gather
    from steelyard.estimate.prior.body_priors import default_knowledge
    from steelyard.logs.formats import open_log
    from steelyard.model.laws.register import DEFAULT_TERMS
    from steelyard.model.model import Model
    from steelyard.robot.file.robot_file import load_robot
    from steelyard.runs.prepare import prepare
    from steelyard.runs.recording import Recording

    loaded = load_robot(given / "demo_arm.toml")
    model = Model(loaded.robot, DEFAULT_TERMS)
    run = prepare(Recording(open_log(given / "identification.csv"), loaded.signals))
    information = gather(base_regressor(model), run)
    estimator = Consistent(base_parameters(model), default_knowledge(model), gamma=10.0)
    best = estimator(information)
    std = best.standard.std if best.standard is not None else best.std
    stopped, off, strange = 0, 0.0, ""
    words = ""
    for most in range(1, 31):
        try:
            found = replace(estimator, iterations=most)(information)
        except Unsolved as error:
            stopped, words = stopped + 1, str(error)
        except SteelyardError as error:
            strange = str(error)
        else:
            gap = np.abs(found.values.values - best.values.values)
            off = max(off, float((gap / np.maximum(std, 1e-12)).max()))
    first = words.split("\n")[0]
    return [
        Claim(
            "solver stopped early: refused", f"{stopped} of 30: {first}"[:90], ">= 5", stopped >= 5
        ),
        Claim(
            "solver stopped early: noted",
            strange or first[:90],
            "says so",
            "stopped before" in words and not strange,
        ),
        Claim("solver called solved: off", f"{off:.1e} std", "<= 1e-2", off <= 1e-2),
    ]


def of_comparison(given: Path, work: Path) -> Claim:
    """An estimator that cannot do it is a row with its reason; the others go on."""
    few = f"{LOG}@1:2.2"
    done = ran(("compare", "../given/demo_arm.toml", few, "--no-check", "--json"), work)
    if done.returncode:
        return Claim("comparison of poor data", done.stderr[:90], "a table", False)
    found = json.loads(done.stdout)["estimators"]
    failed = {one["estimator"]: one["failures"][0]["reason"] for one in found if one["failures"]}
    sound = len(found) - len(failed)
    bare = [reason for reason in failed.values() if "it failed:" in reason or not reason]
    return Claim(
        "comparison of poor data",
        f"{sound} sound, failed: {'; '.join(f'{k}: {v}' for k, v in failed.items()) or 'none'}"[
            :140
        ],
        "every failure has a reason of ours",
        sound > 0 and not bare,
    )


def main() -> list[Claim]:
    """All of them."""
    from steelyard.simulate.simulate import demo_runs

    with tempfile.TemporaryDirectory() as folder:
        given, work = Path(folder) / "given", Path(folder) / "work"
        demo_runs(given, period=2.0)
        work.mkdir()
        claims = [claim for name in PRIORS for claim in of_prior(name, given, work)]
        claims += [of_refusal(name, given, work) for name in REFUSED]
        claims += [*of_rest(given, work), *of_solver(given), of_comparison(given, work)]
        return claims


if __name__ == "__main__":
    main_of(main)
