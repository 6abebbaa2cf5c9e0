"""Installation: every package that steelyard needs is a wheel on all platforms; size and time.

pip resolves the pinned packages of each platform and Python from the package index, wheels only.
It evaluates markers inside of foreign packages for the Python that runs this, so Python 3.14, where
one of them is not needed, is not among those examined. Macs with Intel processors are not either:
llvmlite and MuJoCo have no wheels for them any more.
"""

import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from proofs.support.claims import Claim, main_of

from steelyard.robot.file.toml_schema import tomllib

ROOT = Path(__file__).parents[2]
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
LARGEST = 600
"""Size of a fresh virtual environment with steelyard [MB]."""


def _linux(processor: str) -> list[str]:
    """Wheels for glibc 2.28 (Ubuntu 20.04, Debian 10) or older."""
    return [f"manylinux2014_{processor}", *(f"manylinux_2_{n}_{processor}" for n in range(17, 29))]


PLATFORMS = {
    "Linux x86-64": _linux("x86_64"),
    "Linux aarch64": _linux("aarch64"),
    "macOS arm64": ["macosx_14_0_arm64"],
    "Windows x86-64": ["win_amd64"],
}


def pinned(lines: list[str], python: str) -> list[str]:
    """Requirements that apply to a version of Python, without their markers."""
    kept = []
    for line in lines:
        one = Requirement(line)
        if one.marker is None or one.marker.evaluate({"python_version": python}):
            kept.append(f"{one.name}{one.specifier}")
    return kept


def wheels(folder: Path, needed: list[str], pins: list[str]) -> Iterator[Claim]:
    """A claim for each platform and Python."""
    pip = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "-q"]
    for platform, tags in PLATFORMS.items():
        for python in PYTHONS:
            constraints = folder / "constraints.txt"
            constraints.write_text("\n".join(pinned(pins, python)), encoding="utf-8")
            named = [word for tag in tags for word in ("--platform", tag)]
            done = subprocess.run(
                [*pip, "--only-binary", ":all:", "--python-version", python, *named]
                + ["--target", str(folder / "none"), "-c", str(constraints)]
                + pinned(needed, python),
                capture_output=True,
                text=True,
            )
            wrong = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
            figure = wrong[-1][7:90] if wrong else f"{len(pinned(needed, python))} packages"
            ok = done.returncode == 0
            yield Claim(f"wheels for {platform}, Python {python}", figure, "wheels only", ok)


def installed(folder: Path) -> Iterator[Claim]:
    """Size of the wheel, size and time of an installation, and whether it works."""
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(ROOT)]
    subprocess.run(build, check=True)
    (wheel,) = folder.glob("steelyard-*.whl")
    megabytes = wheel.stat().st_size / 1e6
    yield Claim("wheel of steelyard", f"{megabytes:.1f} MB", "≤ 5 MB", megabytes <= 5.0)
    place = folder / "venv"
    venv.create(place, with_pip=True)
    bin_ = place / ("Scripts" if sys.platform == "win32" else "bin")
    pip = [str(bin_ / "python"), "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt")]
    begun = time.monotonic()
    subprocess.run([*pip, str(wheel)], check=True)
    seconds = time.monotonic() - begun
    files = [file for file in place.rglob("*") if file.is_file() and not file.is_symlink()]
    size = sum(file.stat().st_size for file in files) / 1e6
    figure = f"{size:.0f} MB in {seconds:.0f} s"
    yield Claim("fresh environment", figure, f"≤ {LARGEST} MB", size <= LARGEST)
    done = subprocess.run([str(bin_ / "steelyard"), "doctor"], capture_output=True, text=True)
    yield Claim("steelyard doctor there", f"exit {done.returncode}", "exit 0", done.returncode == 0)


def main() -> list[Claim]:
    """Ask the index for all platforms, and install once."""
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").split("\n")[:-1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        return [*wheels(folder, needed["project"]["dependencies"], pins), *installed(folder)]


if __name__ == "__main__":
    main_of(main)
