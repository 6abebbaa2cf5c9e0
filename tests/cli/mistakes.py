"""Mistakes that users make with the commands, and the words that must answer them.

Shared by the tests and by `proofs/product/errors.py`. Commands run in the folder `work` of a
workshop and find their files in `../given`; whatever is left in `work` is a leftover.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from short_arm import short_logs

GIVEN = "../given"
ROBOT, LOG = f"{GIVEN}/demo_arm.toml", f"{GIVEN}/identification.csv"
IDENTIFY = ("identify", ROBOT, LOG)
PLAIN = ("--no-check", "--method", "OLS")
"""Options with which `identify` takes least time: of tests of what is beside the estimate."""


@dataclass(frozen=True)
class Mistake:
    """A command line that cannot work, and words that the message must hold."""

    name: str
    arguments: tuple[str, ...]
    words: tuple[str, ...]


def identify(
    name: str, robot: str, log: str, *words: str, options: tuple[str, ...] = ()
) -> Mistake:
    return Mistake(name, ("identify", f"{GIVEN}/{robot}", f"{GIVEN}/{log}", *options), words)


def with_robot(name: str, robot: str, *words: str) -> Mistake:
    return identify(name, robot, "identification.csv", *words)


def with_log(name: str, log: str, *words: str) -> Mistake:
    return identify(name, "demo_arm.toml", log, *words)


def output(name: str, folder: str, *words: str) -> Mistake:
    return Mistake(name, (*IDENTIFY, "-o", folder), words)


USER = (
    with_log("missing log", "identificatoin.csv", "no such log", "'identification.csv'"),
    with_robot("missing robot file", "demo_arn.toml", "there is no such file", "'demo_arm.toml'"),
    with_robot("text instead of a URDF", "letter.urdf", "letter.urdf", "XML"),
    with_robot("XML that is no robot", "page.urdf", "page.urdf", "html"),
    with_robot("entity bomb", "bomb.urdf", "bomb.urdf", "entit"),
    with_robot("external entity", "external.urdf", "external.urdf", "entit"),
    with_robot("a column that the log lacks", "column.toml", "'tua1_Nm'", "tau1_Nm"),
    with_robot("a joint that does not exist", "joint.toml", "elbwo", "elbow"),
    with_robot("too few columns", "count.toml", "2", "3"),
    with_robot("unknown key", "key.toml", "key.toml", "line 12", "veloctiy", "velocity"),
    with_robot("broken TOML", "broken.toml", "broken.toml", "line 3"),
    with_robot("negative cut-off", "negative.toml", "negative.toml", "matched_cutoff"),
    with_robot("unknown friction law", "law.toml", "viscuos", "viscous"),
    with_log("log shorter than its filter", "identification.csv@1:1.1", "shorter"),
    with_log("static log", "identification.csv@0:0.9", "no joint moves"),
    with_log("static log, every value constant", "static.csv", "no joint moves"),
    with_log("empty CSV", "empty.csv", "empty", "empty.csv"),
    with_log("header alone", "header.csv", "header.csv"),
    with_log("every row broken", "broken.csv", "broken.csv"),
    with_log("Parquet that is not one", "letter.parquet", "letter.parquet", "Parquet"),
    with_log("Parquet of words", "words.parquet", "words.parquet"),
    with_log("unknown suffix", "log.xyz", "log.xyz", ".parquet"),
    with_log("folder without a log", "nothing", "the folder holds no log", "nothing"),
    with_log("cut backwards", "identification.csv@9:3", "ends (3)", "starts (9)"),
    with_log("cut of words", "identification.csv#a:b", "'a' is not a row"),
    with_log("cut beyond the log", "identification.csv@900:990", "identification.csv"),
    identify(
        "missing validation log",
        "demo_arm.toml",
        "identification.csv",
        "no such log",
        options=("--validate", f"{GIVEN}/nothing.csv"),
    ),
    Mistake(
        "log before the robot file",
        ("identify", f"{LOG}@0:5", ROBOT, "--json"),
        ("in the place of the robot file", f"steelyard identify {ROBOT} {LOG}@0:5"),
    ),
    Mistake(
        "log before the robot file, missing",
        ("check", "no.parquet", "other.csv@0:5"),
        ("robot file first, then logs: steelyard check ROBOT no.parquet other.csv@0:5",),
    ),
    Mistake(
        "folder of a log before the robot file",
        ("check", "bag", ROBOT),
        ("is a robot file", f"steelyard check {ROBOT} bag"),
    ),
    Mistake(
        "robot file among the logs",
        ("identify", ROBOT, f"{GIVEN}/demo_arm.urdf", LOG),
        ("demo_arm.urdf' is among the logs", f"steelyard identify {ROBOT} {LOG}"),
    ),
    Mistake(
        "log before the URDF",
        ("init", LOG, f"{GIVEN}/demo_arm.urdf"),
        (f"robot model first, then logs: steelyard init {GIVEN}/demo_arm.urdf {LOG}",),
    ),
    Mistake(
        "log before the model",
        ("wrench", LOG, "steelyard-arm"),
        (f"model first, then logs: steelyard wrench steelyard-arm {LOG}",),
    ),
    output("output folder exists", GIVEN, "exists already", "--output"),
    output("output below a file", f"{ROBOT}/out", "cannot be written", "Not a directory"),
    output("output below a file's file", f"{ROBOT}/deep/out", "cannot be written"),
    output("output in /proc", "/proc/steelyard/out", "cannot be written", "/proc"),
    Mistake("validate, no model", ("validate", "nothing", LOG), ("cannot be read", "nothing")),
    Mistake(
        "validate, folder without a model",
        ("validate", GIVEN, LOG),
        ("cannot be read", "model.json"),
    ),
    Mistake("validate, damaged model", ("validate", f"{GIVEN}/damaged.json", LOG), ("damaged",)),
    Mistake(
        "validate, a robot file",
        ("validate", ROBOT, LOG),
        ("a robot file, not an identified model", "demo_arm.toml"),
    ),
    Mistake(
        "validate, not JSON", ("validate", f"{GIVEN}/demo_arm.urdf", LOG), ("not JSON", ".urdf")
    ),
    Mistake(
        "validate, another JSON",
        ("validate", f"{GIVEN}/truth.json", LOG),
        ("not an identified model",),
    ),
    Mistake(
        "simulate, not a motion",
        ("simulate", ROBOT, "--motion", f"{GIVEN}/truth.json"),
        ("truth.json",),
    ),
    Mistake("simulate, no motion", ("simulate", ROBOT, "--motion", "no.json"), ("no.json",)),
    Mistake("simulate, no robot", ("simulate", "no.urdf"), ("no such file", "no.urdf")),
    Mistake("simulate, folder exists", ("simulate", ROBOT, "-o", GIVEN), ("exists already",)),
    Mistake("demo, folder exists", ("demo", "-o", GIVEN), ("exists already", "--output")),
    Mistake("init, no URDF", ("init", "no.urdf"), ("no such file", "no.urdf")),
    Mistake(
        "init, file exists", ("init", f"{GIVEN}/demo_arm.urdf", "-o", ROBOT), ("exists already",)
    ),
    Mistake(
        "init, log missing", ("init", f"{GIVEN}/demo_arm.urdf", "no.csv"), ("no such log", "no.csv")
    ),
    Mistake("check, log missing", ("check", ROBOT, "no.csv"), ("no such log", "no.csv")),
    Mistake("check, no robot", ("check", "no.toml", LOG), ("no such file", "no.toml")),
    Mistake("check, no model", ("check", ROBOT, LOG, "--model", "no"), ("cannot be read", "no")),
    Mistake("check, file exists", ("check", ROBOT, LOG, "--fix", ROBOT), ("exists already",)),
    Mistake("check, folder exists", ("check", ROBOT, LOG, "-o", GIVEN), ("exists already",)),
    Mistake(
        "check, no such folder",
        ("check", f"{GIVEN}/clock.toml", LOG, "--fix", "deep/arm.toml"),
        ("cannot be written", "deep/arm.toml"),
    ),
    Mistake(
        "init, no such folder",
        ("init", f"{GIVEN}/demo_arm.urdf", "-o", "deep/arm.toml"),
        ("cannot be written", "deep/arm.toml"),
    ),
)
"""Answered by our own messages: what is wrong, where, and how to correct it."""

USAGE = (
    Mistake("negative noise", ("simulate", ROBOT, "--noise", "-1"), ("--noise",)),
    Mistake("no threads", (*IDENTIFY, "--threads", "0"), ("--threads",)),
    Mistake("noise of words", ("simulate", ROBOT, "--noise", "loud"), ("--noise", "valid number")),
    Mistake("period too short", ("simulate", ROBOT, "--period", "0.1"), ("--period",)),
    Mistake("no log", ("identify", ROBOT), ("LOG",)),
    Mistake("unknown option", (*IDENTIFY, "--valdiate", LOG), ("--valdiate",)),
    Mistake("--validate without a log", (*IDENTIFY, "--validate"), ("--validate",)),
    Mistake("--validate before an option", (*IDENTIFY, "--validate", "--json"), ("--validate",)),
    Mistake("unknown command", ("identfy", ROBOT, LOG), ("identfy",)),
)
"""Answered by the command line's own usage message."""


def workshop(folder: Path) -> Path:
    """Make files to go wrong with; the empty folder to run commands in."""
    given = folder / "given"
    given.mkdir()
    short_logs(given)
    _robots(given)
    _logs(given)
    (given / "nothing").mkdir()
    (given / "damaged.json").write_text(
        '{"schema": "steelyard.model", "schema_version": 3, "model": {"robot": 3}}'
    )
    work = folder / "work"
    work.mkdir()
    return work


def _robots(given: Path) -> None:
    laugh = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
    texts = {
        "letter.urdf": "Dear robot,\nplease move.\n",
        "page.urdf": "<html><body/></html>",
        "bomb.urdf": f'<!DOCTYPE r [<!ENTITY l0 "ha">{laugh}]><robot name="r">&l9;</robot>',
        "external.urdf": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
        '<robot name="r">&x;</robot>',
        "broken.toml": '[robot]\nurdf = "demo_arm.urdf"\nbase = = 3\n',
    }
    for name, text in texts.items():
        (given / name).write_text(text)
    good = (given / "demo_arm.toml").read_text()
    some = ", ".join(f'"tau{k}_Nm"' for k in range(1, 3))
    for name, old, new in (
        ("column.toml", '"tau{}_Nm"', '"tua{}_Nm"'),
        ("joint.toml", 'urdf = "demo_arm.urdf"\n', 'urdf = "demo_arm.urdf"\njoints = ["elbwo"]\n'),
        ("count.toml", '"tau{}_Nm"', f"[{some}]"),
        ("key.toml", "velocity =", "veloctiy ="),
        ("negative.toml", "[signals]\n", "[processing]\nmatched_cutoff = -3.0\n\n[signals]\n"),
        ("law.toml", '"viscous"', '"viscuos"'),
        ("clock.toml", '"time_s"', '"time_s"\ntime_unit = "ms"'),
    ):
        assert old in good
        (given / name).write_text(good.replace(old, new))


def _logs(given: Path) -> None:
    table = pl.read_csv(given / "identification.csv")
    still = {c: pl.lit(0.3 if c.startswith("q") else 0.0).alias(c) for c in table.columns[1:]}
    table.select(table.columns[0], *still.values()).write_csv(given / "static.csv")
    header = ",".join(table.columns)
    (given / "empty.csv").write_text("")
    (given / "header.csv").write_text(f"{header}\n")
    (given / "broken.csv").write_text(f"{header}\n" + "nothing here\n" * 300)
    (given / "letter.parquet").write_text("Dear robot,\n")
    (given / "log.xyz").write_text("1 2 3\n")
    pl.DataFrame({"words": ["a", "b"]}).write_parquet(given / "words.parquet")
    _soiled(table, given / "soiled.csv")


SPOILT = {"NaN": 7, "1e293": 5, "cut short": 3}
"""Broken rows of `soiled.csv`, by kind."""


def _soiled(table: pl.DataFrame, path: Path) -> None:
    """A good log with some broken rows in it."""
    lines = table.write_csv().splitlines()
    rng = np.random.default_rng(1)
    chosen = iter(rng.choice(np.arange(600, 1000), sum(SPOILT.values()), replace=False).tolist())
    for kind, count in SPOILT.items():
        for _ in range(count):
            row = next(chosen)
            cells = lines[row].split(",")
            if kind == "cut short":
                lines[row] = ",".join(cells[:4])
            else:
                lines[row] = ",".join([*cells[:3], kind, *cells[4:]])
    path.write_text("\n".join(lines) + "\n")


def leftovers(work: Path) -> list[str]:
    """What a command left behind, hidden parts included."""
    found = [*work.iterdir(), *work.parent.rglob(".*.part"), *work.parent.glob("given/out")]
    return [str(path) for path in found]


def faults(mistake: Mistake, code: int, stdout: str, stderr: str, work: Path) -> list[str]:
    """What is wrong with the answer to a mistake; nothing, if all is well."""
    lines = stderr.splitlines()
    found = [f"lacks {word!r}" for word in mistake.words if word not in stderr]
    if mistake in USER:
        shape = [line.split()[0] if line.split() else "" for line in lines]
        if shape != ["error:", "where", "fix"]:
            found.append("is not three lines: what, where, correct")
    if code != 2:
        found.append(f"exit code {code}")
    if "Traceback" in stderr:
        found.append("shows a traceback")
    if stdout.strip():
        found.append("writes to standard output")
    return found + [f"leaves {name}" for name in leftovers(work)]
