"""Files from strangers: models, robot files, logs and `model.json` with something broken in them.

Every file is read in a long-lived child with 2 GB of room and 20 s a file, which is started again
when it dies: an error that says what is wrong, where and how to correct it, or a result without a
number that is none; no traceback, hang or kill.
`python -m proofs.logs.mutated_files FILES [KIND...]` reads that many files.
"""

import math
import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from proofs.logs.fuzzing import Limits, Outcome, mutated, outcomes
from proofs.support.claims import Claim, main_of
from proofs.support.log_files import Table, message_columns, write_messages, write_tables

from steelyard.estimate.identified_model import load_model
from steelyard.identify.identify import identify
from steelyard.logs.formats import open_log
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import Recording
from steelyard.simulate.simulate import demo_runs

FILES = 8_000
LIMITS = Limits(seconds=20.0, room=2048.0)
IN_CHILDREN = ("MATLAB 7.3", "HDF5", "MJCF")  # kinds of which a process is started for each file
SLOW = 0.02  # number of these over that of others
NUMBERS = (
    *("0", "-1", "1e308", "-1e308", "nan", "inf", "-inf", "9" * 400, "1" + "0" * 30),
    *("", "-0.0", "1e-320", "true", "0x10", "1,5", "+-1"),
)
NAMES = (
    "",
    "\x00",
    "\x1b[31m",
    "a\nb",
    "\u202e",
    "../..",
    "${a}",
    "$(a)",
    "a" * 5000,
    "\ufeff",
    "'",
    "<",
)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
QUOTED = re.compile(r"\"[^\"\n]*\"|'[^'\n]*'")
CELL = re.compile(r"[^,;\n]+")

XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="side" default="left"/>
<xacro:property name="mass" value="2.5"/>
<xacro:property name="sizes" value="${dict(a=0.3, b=[0.1, 0.2])}"/>
<xacro:macro name="arm_link" params="name parent *origin length:=0.3">
  <link name="${name}"><inertial>
  <origin xyz="0 0 ${length / 2}"/><mass value="${mass * 1.1}"/>
  <inertia ixx="${mass * length**2 / 12}" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.003"/>
  </inertial></link>
  <joint name="${parent}_${name}" type="revolute"><parent link="${parent}"/><child link="${name}"/>
  <xacro:insert_block name="origin"/><axis xyz="0 ${cos(0)} 0"/>
  <limit lower="${-pi}" upper="${radians(170)}" velocity="3" effort="50"/></joint>
</xacro:macro>
<link name="base"/>
<xacro:arm_link name="upper" parent="base">
<origin xyz="0 0 0.1" rpy="0 0 ${pi/2}"/></xacro:arm_link>
<xacro:arm_link name="fore" parent="upper" length="${sizes['a']}">
<origin xyz="0 0 0.3"/></xacro:arm_link>
<xacro:if value="${'$(arg side)' == 'left'}"><link name="tool"/><joint name="fix" type="fixed">
<parent link="fore"/><child link="tool"/></joint></xacro:if>
</robot>
"""
MJCF = """<mujoco model="arm"><compiler angle="radian" autolimits="true"/>
<default><joint damping="0.1" armature="0.01"/>
<default class="small"><geom size="0.02"/></default></default>
<worldbody><body name="upper" pos="0 0 0.1"><joint name="j1" axis="0 0 1" range="-3 3"/>
<inertial pos="0 0 0.1" mass="2" diaginertia="0.02 0.02 0.01"/>
<body name="fore" pos="0 0 0.3" euler="0 0.2 0">
<joint name="j2" type="hinge" axis="0 1 0" frictionloss="0.2"/>
<geom class="small" type="capsule" fromto="0 0 0 0 0 0.3" density="800"/>
<site name="tip" pos="0 0 0.3"/>
</body></body></worldbody>
<actuator><motor name="m1" joint="j1" gear="50"/><motor name="m2" joint="j2"/></actuator></mujoco>
"""
MORE_TOML = """
[processing]
outliers = 15.0
motion_cutoff = 12.0
matched_cutoff = 4.0

[estimation]
method = "WLS"

[[knowledge]]
kind = "mass"
link = "forearm"
lower = 0.1
upper = 5.0

[robot.limits.elbow]
velocity = 2.0
effort = 40.0
"""


def main(files: int = FILES, kinds: tuple[str, ...] = ()) -> list[Claim]:
    """All kinds of files, as many of each; fewer of those that are slow."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seeds = {
            kind: seed for kind, seed in sound_files(folder).items() if not kinds or kind in kinds
        }
        shares = {kind: SLOW if kind in IN_CHILDREN else 1.0 for kind in seeds}
        each = files / sum(shares.values())
        claims = []
        for kind, (path, mutation, read) in seeds.items():
            read(str(path))
            rng, count = random.Random(kind), math.ceil(each * shares[kind])
            broken = (mutation(path, rng) for _ in range(count))
            # beside the sound file, so that what it names is found
            found = list(outcomes(path.parent, path, broken, read, LIMITS))
            claims.append(judged(kind, found))
            print(claims[-1].name, claims[-1].value, file=sys.stderr, flush=True)
        return claims


def judged(kind: str, found: list[Outcome]) -> Claim:
    """A claim on all files of one kind."""
    counts = Counter(outcome.kind for outcome in found)
    bad = {what: n for what, n in counts.items() if what not in ("error", "table")}
    longest = max((o.seconds for o in found), default=0.0)
    figure = f"{counts['error']} errors, {counts['table']} results, {longest:.1f} s at most"
    figure += f"; {bad}" if bad else ""
    bound = "no traceback, hang, kill, silent NaN"
    return Claim(f"{len(found)} mutated files: {kind}", figure, bound, not bad)


Mutation = Callable[[Path, random.Random], bytes]
Seed = tuple[Path, Mutation, Callable[[str], float]]


def sound_files(folder: Path) -> dict[str, Seed]:
    """A sound file per kind, how it is mutated and read."""
    t = np.arange(400) / 100.0
    phase = np.arange(2)[:, None] + 3.0 * np.array([[1.0], [1.7]]) * t
    q, dq, tau = np.sin(phase).T, np.cos(phase).T, 5.0 * np.sin(phase).T
    tau = tau + np.random.default_rng(0).normal(size=tau.shape)
    table = Table(("a", "b"), 10**18 + 10_000_000 * np.arange(len(t)), q, dq, tau)
    logs = folder / "logs"
    logs.mkdir()
    paths = {label: path for label, path in write_tables(logs, table).items() if path.is_file()}
    for label, path in write_messages(logs, table).items():
        inside = [path] if path.is_file() else [p for p in path.iterdir() if p.suffix != ".yaml"]
        paths[label] = inside[0]
    found: dict[str, Seed] = {}
    for label, path in paths.items():
        text = path.suffix == ".csv"
        mutation = of_text if text else with_values(path) if path.suffix in WRITERS else of_bytes
        found[label] = path, mutation, read_log
    demo_runs(folder / "arm")
    model = folder / "arm" / "model"
    log = f"{folder / 'arm' / 'identification.csv'}@0:6"
    identify(folder / "arm" / "demo_arm.toml", log, check=False).save(model)
    (folder / "arm" / "arm.xacro").write_text(XACRO)
    (folder / "arm" / "arm.xml").write_text(MJCF)
    robot = folder / "arm" / "demo_arm.toml"
    robot.write_text(robot.read_text() + MORE_TOML)
    for label, path in {
        "URDF": folder / "arm" / "demo_arm.urdf",
        "xacro": folder / "arm" / "arm.xacro",
        "MJCF": folder / "arm" / "arm.xml",
        "robot file": robot,
    }.items():
        found[label] = path, of_text, read_robot
    found["model.json"] = model / "model.json", of_text, read_model
    return found


WRITERS: dict[str, Callable[[Path, dict[str, np.ndarray]], object]] = {
    ".npz": lambda path, arrays: np.savez(path, **arrays),
    ".parquet": lambda path, arrays: pl.DataFrame(
        {f"{k}_{j}" if a.ndim > 1 else k: column for k, a in arrays.items()
         for j, column in enumerate(np.atleast_2d(a.T), 1)}
    ).write_parquet(path),
}  # fmt: skip
"""Tables that are written anew with other values, beside bytes that are changed."""


def of_bytes(path: Path, rng: random.Random) -> bytes:
    """Bytes flipped, removed, inserted, repeated, cut off."""
    return mutated(path.read_bytes(), rng)


def with_values(path: Path) -> Mutation:
    """Other values and names in a sound table of this kind, as often as other bytes."""

    def mutation(sound: Path, rng: random.Random) -> bytes:
        if rng.random() < 0.5:
            return of_bytes(sound, rng)
        t = np.arange(400) / 100.0
        arrays = {"t": t, **{k: np.sin(np.outer(t, [3.0, 5.0])) for k in ("q", "dq", "tau")}}
        for _ in range(rng.choice((1, 1, 2, 5))):
            name = rng.choice(list(arrays))
            flat = arrays[name].reshape(-1)
            at = slice(*sorted(rng.choices(range(len(flat) + 1), k=2)))
            values = (0.0, -1.0, 1e308, np.nan, np.inf, 1e30, 5e-324, -1e308)
            flat[at] = rng.choice(values)
            if rng.random() < 0.2:
                other = rng.choice(list(arrays))
                arrays[name], arrays[other] = arrays[other], arrays[name]
            if rng.random() < 0.1:
                arrays[rng.choice(NAMES[1:4]).replace("\x00", "0")] = arrays.pop(name)
            if name in arrays and rng.random() < 0.1:
                arrays[name] = arrays[name][: rng.randrange(5)]
        target = sound.with_name(f"written{path.suffix}")
        try:
            WRITERS[path.suffix](target, arrays)
        except Exception:  # the writer refuses it: as it stands
            return of_bytes(sound, rng)
        return target.read_bytes()

    return mutation


def of_text(path: Path, rng: random.Random) -> bytes:
    """Numbers, texts, lines and levels of a text file changed, or its bytes."""
    raw = path.read_bytes()
    if rng.random() < 0.25:
        return mutated(raw, rng)
    text = raw.decode()
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        text = rng.choice(OF_TEXT)(text, rng)
    return text.encode("utf-8", "surrogatepass")


def _token(pattern: re.Pattern[str], text: str, rng: random.Random) -> re.Match[str] | None:
    """A random match, found from a random place on."""
    start = rng.randrange(len(text) + 1)
    return pattern.search(text, start) or pattern.search(text)


def _other(
    pattern: re.Pattern[str], values: tuple[str, ...], quote: str = ""
) -> Callable[..., str]:
    def changed(text: str, rng: random.Random) -> str:
        one = _token(pattern, text, rng)
        if one is None:
            return text
        return f"{text[: one.start()]}{quote}{rng.choice(values)}{quote}{text[one.end() :]}"

    return changed


def _swapped(pattern: re.Pattern[str]) -> Callable[..., str]:
    def changed(text: str, rng: random.Random) -> str:
        pair = sorted(
            (m for m in (_token(pattern, text, rng) for _ in range(2)) if m),
            key=lambda m: m.start(),
        )
        if len(pair) < 2 or pair[0].end() > pair[1].start():
            return text
        a, b = pair
        middle = text[a.end() : b.start()]
        return f"{text[: a.start()]}{b[0]}{middle}{a[0]}{text[b.end() :]}"

    return changed


def _lines(text: str, rng: random.Random) -> str:
    """Lines removed, repeated or moved."""
    lines = text.splitlines(keepends=True)
    if len(lines) < 3:  # one long line: at marks within it
        lines = re.split(r"(?<=[,>}])", text)
    a, b = sorted(rng.choices(range(len(lines) + 1), k=2))
    b = min(b, a + rng.choice((1, 3, 20)))
    block = lines[a:b]
    place = rng.randrange(len(lines) + 1)
    removed = lines[:a] + lines[b:] if rng.random() < 0.6 else lines
    if rng.random() < 0.6:
        removed = removed[:place] + block * rng.choice((1, 1, 2, 50)) + removed[place:]
    return "".join(removed)


def _nested(text: str, rng: random.Random) -> str:
    """Levels upon levels."""
    depth = rng.choice((3, 100, 3000, 100_000))
    pairs = (
        ("[", "]"),
        ("{", "}"),
        ('{"a":', "}"),
        ("<link>", "</link>"),
        ("(", ")"),
        ("<a.", ">"),
    )
    opened, closed = rng.choice(pairs)
    at = rng.randrange(len(text) + 1)
    one = _token(NUMBER, text, rng)
    if one is not None and rng.random() < 0.5:
        return f"{text[: one.start()]}{opened * depth}{one[0]}{closed * depth}{text[one.end() :]}"
    return text[:at] + opened * depth + (closed * depth if rng.random() < 0.5 else "") + text[at:]


OF_TEXT: tuple[Callable[[str, random.Random], str], ...] = (
    _other(NUMBER, NUMBERS),
    _other(NUMBER, NUMBERS),
    _other(NUMBER, NUMBERS),
    _other(QUOTED, NAMES, '"'),
    _other(QUOTED, NUMBERS, '"'),
    _other(CELL, (*NUMBERS, *NAMES)),
    _swapped(NUMBER),
    _swapped(QUOTED),
    _lines,
    _nested,
)


def read_robot(path: str) -> float:
    """A robot, of which no number may be NaN."""
    return _refuse_nan(load_robot(path))


def read_model(path: str) -> float:
    """An identified model, likewise: NaN only where the sound one may have it."""
    found = load_model(path)
    return _refuse_nan((found.model.robot, found.estimate.parameters.values, found.signals.gains))


def read_log(path: str) -> float:
    """A log to its last row, and its run if it has the columns of the sound one."""
    log = open_log(path)
    names = [name for name in dict.fromkeys(log.columns) if log.columns.count(name) == 1][:64]
    rows = 0
    for part in log.parts(names):
        if part.dtype != np.float64 or part.ndim != 2 or part.shape[1] != len(names):
            raise TypeError(f"a part of {part.dtype} and shape {part.shape}")
        rows += len(part)
        if rows > 400_000:
            break
    table = Table(("a", "b"), np.zeros(1), *np.zeros((3, 1, 2)))
    plain = {name: name for name in table.columns}
    arrays = {f"{k}_{j}": f"{k}[{j - 1}]" for k in ("q", "dq", "tau") for j in (1, 2)}
    for known in (plain, {"t": "t", **arrays}, message_columns(table)):
        if set(known.values()) <= set(names):
            q, dq, tau = ((known[f"{k}_1"], known[f"{k}_2"]) for k in ("q", "dq", "tau"))
            ones = np.ones(2)
            signals = Signals(
                known["t"], 1.0, q, ones, dq, ones, tau, ones, "joint_torque", ("Nm",) * 2, ones
            )
            run = prepare(Recording(log, signals).unwrapped(), Processing())
            return _refuse_nan(run.whole())
    return 0.0


class SilentNaN(ArithmeticError):
    """A result has a number that is none."""


def _refuse_nan(result: Any) -> float:
    for name, value in _numbers(result, type(result).__name__, set()):
        if np.isnan(value).any():
            raise SilentNaN(name)
    return 0.0


def _numbers(value: Any, name: str, seen: set[int]) -> Iterator[tuple[str, Any]]:
    """All numbers in a value, with their names."""
    if isinstance(value, float | np.ndarray):
        if isinstance(value, float) or value.dtype.kind == "f":
            yield name, value
    elif id(value) in seen or isinstance(value, str | bytes):
        return
    else:
        seen.add(id(value))
        if is_dataclass(value) and not isinstance(value, type):
            for one in fields(value):
                yield from _numbers(getattr(value, one.name), f"{name}.{one.name}", seen)
        elif isinstance(value, dict):
            for key, one in value.items():
                yield from _numbers(one, f"{name}[{key}]", seen)
        elif isinstance(value, list | tuple):
            for one in value:
                yield from _numbers(one, name, seen)


if __name__ == "__main__":
    count = int(sys.argv[1]) if sys.argv[1:] else FILES
    main_of(lambda: main(count, tuple(sys.argv[2:])))
