"""Fresh clone, bare environment: `make demo` and `make test` succeed, nothing installed by hand."""

import subprocess
import sys
import tempfile
from pathlib import Path

from proofs.support.claims import Claim, main_of

ROOT = Path(__file__).parents[2]


def _make(clone: Path, target: str, python: str) -> Claim:
    done = subprocess.run(
        ["make", "-C", str(clone), target, f"PYTHON={python}"], capture_output=True, text=True
    )
    last = (done.stdout.strip() or done.stderr.strip() or "no output").splitlines()[-1]
    return Claim(f"make {target} in a fresh clone", last[-70:], "exit 0", done.returncode == 0)


def main() -> list[Claim]:
    """Clone what is committed, and do what the README says."""
    python = getattr(sys, "_base_executable", sys.executable)
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "clone"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        return [_make(clone, target, python) for target in ("demo", "test")]


if __name__ == "__main__":
    main_of(main)
