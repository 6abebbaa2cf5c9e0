"""Logs of a fleet in parts: which robot and day each is of, and which rows.

Robot and day come from a table, from a pattern such as `{robot}/{day}`, or by themselves: the day
is the date in a path, or the number behind "day", the robot is what is left of the path.
"""

import csv
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path, PurePosixPath

from steelyard.base.errors import LogError, SteelyardError
from steelyard.logs.files_and_urls import (
    StoredFile,
    files_of,
    is_url,
    path_of,
    without_secrets,
)
from steelyard.logs.log_parts import LogPart, pieces_of

DATE = re.compile(
    r"(?<![A-Za-z0-9])((?:19|20)\d\d)([-_]?)(0[1-9]|1[0-2])\2(0[1-9]|[12]\d|3[01])(?!\d)"
)
DAY = re.compile(r"(?<![a-zA-Z])[dD]ay[-_]?(\d+)(?!\d)")
SEPARATORS = " -_./"


def parts_of(
    logs: Sequence[str], names: str | None = None
) -> tuple[tuple[LogPart, ...], tuple[str, ...]]:
    """The parts of all logs, by robot, day and file; and files whose paths do not say the day.

    Args:
        logs: Files, folders, patterns with `*`, URLs; or tables of logs: CSV with the columns log,
            robot, day and, if known, temperature, which names logs relative to itself.
        names: How robot and day stand in the paths: `{robot}/{day}` or `{robot}_{day}_*`.

    Raises:
        LogError: There is no log, none has a day, several folders have a robot of one name, or a
            table is not as it should be.
    """
    pattern = None if names is None else _pattern(names)
    whole, nameless, roots = list[LogPart](), list[LogError](), dict[str, set[str]]()
    for argument in logs:
        table = _table(argument)
        if table is not None:
            whole += _of_table(*table)
            continue
        for file in files_of(argument):
            try:
                robot, day, root = _named(file.url, pattern, names, argument)
            except LogError as error:
                nameless.append(error)
                continue
            whole.append(LogPart(file, robot, day))
            roots.setdefault(robot, set()).add(root)
    if nameless and not whole:
        raise nameless[0]
    for robot, places in roots.items():
        if len(places) > 1 and names is None:
            one, other = sorted(places)[:2]
            raise LogError(
                f"two folders have a robot '{robot}': is it one?",
                where=f"{without_secrets(one)} and {without_secrets(other)}",
                fix='if so, say it with --names "{robot}/{day}"; if not, name the folder above '
                "both, or give a table of logs",
            )
    twice = [url for url, n in Counter(part.file.url for part in whole).items() if n > 1]
    if twice:
        raise LogError(
            "a log is named twice", where=without_secrets(twice[0]), fix="name every log once"
        )
    found = [piece for part in whole for piece in pieces_of(part)]
    left = tuple(f"{error.where}: {error.wrong}" for error in nameless)
    return tuple(sorted(found, key=lambda part: part.place)), left


def _pattern(names: str) -> "re.Pattern[str]":
    """A pattern of paths as a regular expression over the end of a path without suffix."""
    if names.count("{robot}") != 1 or names.count("{day}") != 1:
        raise LogError(
            "the pattern does not name robot and day once each",
            where=f"names (--names) {names}",
            fix='give one such as "{robot}/{day}" or "{day}/{robot}_*"',
        )
    text = re.escape(names.removesuffix("/*").removesuffix("*"))
    for escaped, expression in (
        (r"\{robot\}", "(?P<robot>[^/]+)"),
        (r"\{day\}", r"(?P<day>[^/]+?)"),
        (r"\*", "[^/]*"),
    ):
        text = text.replace(escaped, expression)
    ends = "(?:/[^/]*)?" if names.endswith("/*") else "[^/]*" if names.endswith("*") else ""
    return re.compile(f"(?:^|/){text}{ends}$")


def _named(
    url: str, pattern: "re.Pattern[str] | None", names: str | None, argument: str
) -> tuple[str, str, str]:
    """Robot and day of a log, and the folder beneath which its path says them."""
    path = PurePosixPath(path_of(url))
    text = str(path.with_suffix(""))
    if pattern is not None:
        match = pattern.search(text)
        if match is None:
            raise LogError(
                f"the path does not fit the pattern {names}",
                where=without_secrets(url),
                fix="change --names, or give a table of logs: CSV with the columns log, robot, day",
            )
        if DATE.search(match["robot"]) and not DATE.search(match["day"]):
            raise LogError(
                f"by the pattern {names} the robot is called '{match['robot']}', like a day",
                where=without_secrets(url),
                fix="exchange {robot} and {day} in --names",
            )
        return match["robot"], match["day"], ""
    named = path_of(argument if is_url(argument) else os.path.abspath(argument))
    begin = re.split(r"/[^/]*[*?\[]", named)[0]  # the folders before a pattern
    inside = text.removeprefix(begin + "/") if text.startswith(begin + "/") else path.stem
    root = text.removesuffix(inside).rstrip("/")
    days = {"-".join(m.group(1, 3, 4)): m for m in DATE.finditer(inside)}
    days |= {f"{int(m[1]):04d}": m for m in DAY.finditer(inside)}
    if len(days) > 1:
        raise LogError(
            f"the path has several days: {', '.join(days)}",
            where=without_secrets(url),
            fix='say which it is, as with --names "{robot}/{day}"',
        )
    for day in days:
        words = [_bare(word) for word in inside.split("/")]
        folders = [word for word in words[:-1] if word]
        return "/".join(folders) or words[-1] or PurePosixPath(root).name or "robot", day, root
    raise LogError(
        "the path of the log has no date, and no number behind 'day'",
        where=without_secrets(url),
        fix='say where robot and day stand, as with --names "{robot}/{day}", or give a table of '
        "logs: CSV with the columns log, robot, day",
    )


def _bare(word: str) -> str:
    """A part of a path without the day, and a time behind it."""
    found = DATE.search(word) or DAY.search(word)
    if found is None:
        return word.strip(SEPARATORS)
    behind = re.sub(r"^[T_-]?\d{4,6}Z?(?![0-9A-Za-z])", "", word[found.end() :])
    return f"{word[: found.start()].strip(SEPARATORS)}{behind.rstrip(SEPARATORS)}".strip(SEPARATORS)


COLUMNS = ("log", "robot", "day")


def _table(argument: str) -> tuple[Path, list[dict[str, str | None]]] | None:
    """The rows of a table of logs; `None` if it is something else."""
    path = Path(argument)
    if is_url(argument) or path.suffix.lower() != ".csv" or not path.is_file():
        return None
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            head = stream.readline()
            names = [name.strip().lower() for name in re.split("[,;\\t]", head.strip())]
            if not {"log", "file", "robot"} & set(names):
                return None
            if not set(COLUMNS) <= set(names):
                raise LogError(
                    f"this table of logs has the columns {', '.join(names)}",
                    where=argument,
                    fix=f"name them {', '.join(COLUMNS)} and, if known, temperature",
                )
            comma = next((mark for mark in ",;\t" if mark in head), ",")
            return path, list(csv.DictReader(stream, fieldnames=names, delimiter=comma))
    except (OSError, UnicodeDecodeError, csv.Error):
        return None  # whoever reads it as a log says what is wrong


def _of_table(table: Path, rows: Sequence[Mapping[str, str | None]]) -> list[LogPart]:
    found = []
    for number, row in enumerate(rows, start=2):
        place = f"{table}, line {number}"
        log, robot, day = (str(row[name] or "").strip() for name in COLUMNS)
        if not (log and robot and day):
            raise LogError("a cell is empty", where=place, fix="give log, robot and day")
        named = log if is_url(log) or Path(log).is_absolute() else str(table.parent / log)
        warm = str(row.get("temperature") or "").strip()
        try:
            degrees = float(warm.replace(",", ".")) if warm else None
            if degrees is not None and not isfinite(degrees):
                raise ValueError
        except ValueError:
            wrong = f"the temperature '{warm}' is not a number"
            raise LogError(wrong, where=place, fix="give a number, or leave it empty") from None
        try:
            files = files_of(named)
        except SteelyardError:  # whoever reads it says why it cannot be read
            files = [StoredFile(named if is_url(named) else os.path.abspath(named), 0, "")]
        found += [LogPart(file, robot, day, temperature=degrees) for file in files]
    if not found:
        raise LogError("the table of logs has no rows", where=str(table), fix="list the logs")
    return found
