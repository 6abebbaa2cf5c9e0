"""Every command of the tutorials does what its page says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs/tutorials").glob("*.md"))
BLOCK = re.compile(r'^```(sh|text|toml)(?: title="([^"]+)")?\n(.*?)^```', re.M | re.S)


@pytest.mark.skipif(sys.platform == "win32", reason="the commands are of a POSIX shell")
@pytest.mark.parametrize("page", [pytest.param(page, id=page.stem) for page in PAGES])
def test_commands_print_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    if not os.environ.get("STEELYARD_DATA"):
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    shell = (
        f'export PATH="{Path(sys.executable).parent}:$PATH" E="{ROOT}/examples" COLUMNS=200; set -e'
    )
    printed = ""
    for kind, title, text in BLOCK.findall(page.read_text("utf-8")):
        if kind == "toml" and title:
            edit(tmp_path / title, text)
        elif kind == "sh":
            done = subprocess.run(
                ["bash", "-c", f"{shell}\n{assignments(page)}\n{text}"],
                cwd=tmp_path,
                capture_output=True,
                text=True,
                env=os.environ | {"OMP_NUM_THREADS": "1"},
            )
            assert done.returncode in (0, 3), done.stdout + done.stderr
            printed = " ".join(done.stdout.split())
        elif kind == "text":
            for line in text.splitlines():
                assert " ".join(line.split()) in printed, f"{line}\nis not in\n{printed}"


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
