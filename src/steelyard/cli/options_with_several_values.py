"""Several values behind one option: `--validate A B` for `--validate A --validate B`."""

import re
from itertools import pairwise

MANY_VALUED_OPTIONS = (
    "--validate",
    "--format",
    "--loaded",
    "--unloaded",
    "--columns",
    "--contacts",
    "--beside",
    "--calibrate",
    "--estimators",
    "--on",
    "--keep",
    "--measured",
    "--sensor-rest",
    "--drop",
    "--temperature",
)
"""Options that take all that follows up to the next option."""


def expanded(arguments: list[str]) -> list[str]:
    """Repeat an option that is followed by several values: `--validate A B` for each of them.

    One without a value goes to the end, where the parser misses it. `--fix` has a value if a robot
    file follows it that is not the command's first argument. `NAME:=VALUE` belongs to
    the xacro file before it.
    """
    arguments = _with_xacro(arguments)
    result: list[str] = []
    bare: list[str] = []
    current: str | None = None
    named = False
    for argument, following in pairwise([*arguments, "-"]):
        if argument.startswith("-"):
            current = argument if argument in MANY_VALUED_OPTIONS else None
            if argument == "--fix" and not (named and following.endswith(".toml")):
                result.append("--fix=")
            elif current is None:
                result.append(argument)
            elif following.startswith("-"):
                bare.append(current)
        elif current is not None:
            result += [current, argument]
        else:
            result.append(argument)
            named = named or len(result) > 1
    return result + bare


def _with_xacro(arguments: list[str]) -> list[str]:
    """Arguments of a xacro file, joined to it, or to the word before them if there is none."""
    words: list[str] = []
    for argument in arguments:
        if words and re.match(r"[A-Za-z_]\w*:=", argument):
            files = [n for n, word in enumerate(words) if ".xacro" in word]
            words[files[-1] if files else -1] += f" {argument}"
        else:
            words.append(argument)
    return words
