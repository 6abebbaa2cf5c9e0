"""Commands of the tutorials, and the lines that their pages show of what they print.

Shared by the tests and by `proofs/product/tutorials.py`, which runs every page.
"""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs/tutorials").glob("*.md"))
BLOCK = re.compile(r'^```(sh|bash|text|toml)(?: title="([^"]+)")?\n(.*?)^```', re.M | re.S)

PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
"""With the interpreter that runs the page, for what else it runs in `bash`."""

Run = Callable[[list[str]], tuple[int, str, str]]
"""From the arguments of `steelyard` to its exit code, what it prints, and the errors."""


def differences(page: Path, folder: Path, run: Run) -> list[str]:
    """Run the commands of a page, which work in a folder; what is not as the page says."""
    printed, found = "", list[str]()
    for kind, title, text in BLOCK.findall(page.read_text("utf-8")):
        if kind == "toml" and title:
            edit(folder / title, text)
        elif kind == "bash":
            path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
            own = {**os.environ, "PYTHONPATH": path, "PATH": PATH}
            subprocess.run(["bash", "-ec", text], cwd=folder, env=own, check=True)
        elif kind == "sh":
            done = [(words, *run(words)) for words in commands(page, text)]
            failed = [one for one in done if one[1] not in (0, 3)]
            found += [f"{' '.join(words)}: exit code {code}\n{e}" for words, code, _, e in failed]
            printed = "\n".join(out for _, _, out, _ in done)
        elif kind == "text":
            lines = [line for line in text.splitlines() if not shows(printed, line)]
            found += [f"{line}\nis not in\n{printed}" for line in lines]
    return found


def all_commands(page: Path) -> list[list[str]]:
    """The arguments of each command of a page."""
    blocks = BLOCK.findall(page.read_text("utf-8"))
    return [words for kind, _, text in blocks if kind == "sh" for words in commands(page, text)]


def shows(printed: str, line: str) -> bool:
    """Whether a line is printed, whole but where … stands for the rest of it."""
    words = " ".join(line.strip("…").split())
    lines = [" ".join(one.split()) for one in printed.splitlines()]
    if line.startswith("…"):
        return any(one.endswith(words) for one in lines)
    return any(one.startswith(words) if line.endswith("…") else one == words for one in lines)


def commands(page: Path, text: str) -> list[list[str]]:
    """The arguments of each command of a block, as the shell gives them to `steelyard`."""
    program = """set -e; steelyard() { printf '%s\\n' "$#" "$@"; }"""
    lines = subprocess.run(
        ["bash", "-c", f"{program}\n{assignments(page)}\n{text}"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    found = []
    while lines:
        count = int(lines.pop(0))
        found.append(lines[:count])
        lines = lines[count:]
    return found


def assignments(page: Path) -> str:
    """Variables that the page's commands set, for those that follow."""
    blocks = (text for kind, _, text in BLOCK.findall(page.read_text("utf-8")) if kind == "sh")
    return "\n".join(re.findall(r"^[A-Z]=.*$", "\n".join(blocks), re.M))


def edit(path: Path, lines: str) -> None:
    """Put lines into a robot file where the key of the first one is."""
    key = lines.split(" = ", 1)[0]
    text, count = re.subn(rf"^{key} = .*\n", lambda _: lines, path.read_text("utf-8"), flags=re.M)
    assert count == 1
    path.write_text(text, "utf-8")
