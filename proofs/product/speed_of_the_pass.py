"""The benchmark's bounds: speed against Pinocchio, memory and accuracy of the pass."""

import os
import re
import subprocess
import sys
from pathlib import Path

from proofs.support.claims import Claim, data_folder, main_of

TIMED = True  # nothing else may run beside it

BENCH = Path(__file__).parents[2] / "benchmarks" / "run.py"


def main() -> list[Claim]:
    """Every line of `make bench` that has a bound."""
    data_folder()
    briefly = {**os.environ, "STEELYARD_BENCH_SECONDS": "1"}  # designs: `make bench` shows them
    done = subprocess.run([sys.executable, str(BENCH)], capture_output=True, text=True, env=briefly)
    claims = []
    for line in done.stdout.splitlines():
        cells = re.split(r"\s{2,}", line.strip())
        if cells[-1] in ("holds", "MISSED"):
            claims.append(Claim(cells[0], cells[1], cells[2], cells[-1] == "holds"))
    if not claims:
        claims = [Claim("make bench", done.stderr[-200:], "a table", False)]
    return claims


if __name__ == "__main__":
    main_of(main)
