"""`identify` on seven UR10e runs with its report, cached kernels or none; `check`; `--help`."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from proofs.robots.scores import EXAMPLES, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, data_folder, main_of

TIMED = True  # nothing else may run beside it


def _identify(folder: Path, number: int, cache: Path) -> float:
    command = [sys.executable, "-m", "steelyard", "identify", str(EXAMPLES / "ur10e.toml")]
    command += [*ur10e_logs(), "--validate", ur10e_validation(), "-o", str(folder / f"{number}")]
    start = time.perf_counter()
    subprocess.run(
        command, check=True, capture_output=True, env={**os.environ, "STEELYARD_CACHE": str(cache)}
    )
    return time.perf_counter() - start


def _check() -> float:
    log = data_folder() / "rokae_ar5" / "ar5_run1_rows0_2300.parquet"
    windows = [f"{log}@{start}:{start + 30}" for start in range(0, 16, 3)]
    command = [sys.executable, "-m", "steelyard", "check", str(EXAMPLES / "rokae_ar5.toml")]
    start = time.perf_counter()
    done = subprocess.run([*command, *windows], capture_output=True, text=True)
    if not done.stdout:  # its exit code says what was found
        raise RuntimeError(done.stderr)
    return time.perf_counter() - start


def _help() -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "steelyard", "--help"], check=True, capture_output=True)
    return time.perf_counter() - start


def main() -> list[Claim]:
    """Wall times; the better of three where the machine is shared."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cold = min(_identify(folder, k, folder / f"cache{k}") for k in range(3))
        warm = min(_identify(folder, k, folder / "cache0") for k in range(3, 6))
    checked = min(_check() for _ in range(2))
    shown = min(_help() for _ in range(3))
    return [
        Claim("identify, 7 UR10e runs, kernels cached", f"{warm:.2f} s", "<= 6 s", warm <= 6.0),
        Claim("identify, 7 UR10e runs, cold", f"{cold:.2f} s", "<= 12 s", cold <= 12.0),
        Claim("check, six windows of 30 s, seven joints", f"{checked:.2f} s", "<= 15 s",
              checked <= 15.0),
        Claim("steelyard --help", f"{shown:.2f} s", "<= 0.5 s", shown <= 0.5),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(main)
