"""Every study in its quick form, as a program of its own: it runs, and no bound is missed."""

import subprocess
import sys
import tempfile
from pathlib import Path

from proofs.support.claims import Claim, main_of

ROOT = Path(__file__).parents[2]


def main() -> list[Claim]:
    """One claim a study."""
    claims = []
    for study in sorted((ROOT / "studies").glob("p[1-9]_*.py")):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, str(study), "-o", f"{folder}/out", "--quick"]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        last = (done.stderr.strip().splitlines() or [""])[-1] if done.returncode else ""
        result = f"exit {done.returncode} {last}".strip()
        claims.append(Claim(f"{study.stem}, quick", result, "exit 0", done.returncode == 0))
    return claims


if __name__ == "__main__":
    main_of(main)
