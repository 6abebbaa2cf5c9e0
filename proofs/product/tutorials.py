"""Every command of every tutorial does what its page says, each as a program of its own."""

import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from proofs.support.claims import Claim, data_folder, main_of

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from tutorial_pages import PAGES, all_commands, differences  # noqa: E402


def _run(folder: Path, words: list[str]) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "steelyard", *words], cwd=folder, capture_output=True, text=True
    )
    return done.returncode, done.stdout, done.stderr


def main() -> list[Claim]:
    """One claim a page."""
    data_folder()
    # what the pages ask the reader to set, and no line that is broken
    os.environ.update(E=str(ROOT / "examples"), COLUMNS="200")
    claims = []
    for page in PAGES:
        with tempfile.TemporaryDirectory() as name:
            wrong = differences(page, Path(name), partial(_run, Path(name)))
        for one in wrong:
            print(f"{page.stem}: {one}", file=sys.stderr)
        count = f"{len(all_commands(page))} commands, {len(wrong)} differences"
        claims.append(Claim(f"tutorial {page.stem}", count, "0 differences", not wrong))
    return claims


if __name__ == "__main__":
    main_of(main)
