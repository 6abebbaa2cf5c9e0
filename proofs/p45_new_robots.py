"""Robots that nobody tuned for: what `init`, `check --fix` and `identify` give, with no code.

Errors [%] on the part of a log that was not fitted, over the whole log: the mean over joints, and
pooled. A robot file is what `init` writes; "documented" adds the facts of the data's README.
"""

import re
import tempfile
from pathlib import Path

from claims import Claim, data_folder, main_of
from p02_scores import identified
from p42_two_faults import run


def error(robot: Path, fit: list[str], unseen: str, name: str, bound: float | None) -> Claim:
    """One row: figures, and the bound on the mean over joints."""
    log = identified("", fit, [unseen], file=robot)["validation"][0]
    mean, pooled = log["mean_percent"], log["pooled_percent"]
    said = "told" if bound is None else f"<= {bound:g} %"
    holds = bound is None or mean <= bound
    return Claim(name, f"{mean:.1f} % mean, {pooled:.1f} % pooled", said, holds)


def drafted(urdf: Path, log: Path, folder: Path) -> Path:
    """What `steelyard init` writes."""
    robot = folder / f"{urdf.stem}.toml"
    run("init", urdf, log, "-o", robot)
    return robot


def ur10(folder: Path) -> list[Claim]:
    """A UR10 of the CB3 series."""
    data = data_folder() / "ur10"
    log = data / "ur10_exciting.parquet"
    robot = drafted(data / "ur10_robot.urdf", log, folder)
    return [error(robot, [f"{log}@0:18"], f"{log}@18:27", "UR10, zero code", 11.0)]


def lwa3(folder: Path) -> list[Claim]:
    """A Schunk LWA3: currents, stale positions, gravity along -y."""
    data = data_folder() / "krang_lwa3"
    fit, unseen = (data / f"krang_lwa3_{part}Data.parquet" for part in ("train", "test"))
    robot = drafted(data / "singlearm.urdf", fit, folder)
    text = robot.read_text()
    text = re.sub(r"(?m)^gain = .*", "gain = [18.71, 18.71, 23.75, 23.75, 8.83, 8.83, 8.83]", text)
    text = re.sub(r"(?m)^gravity = .*", "gravity = [0.0, -9.81, 0.0]", text)
    documented = folder / "documented.toml"
    documented.write_text(text)
    return [error(documented, [str(fit)], str(unseen), "LWA3, documented facts", 17.9)]


def med7(folder: Path) -> list[Claim]:
    """A KUKA Med 7 whose torques count against its URDF; four joints carry next to nothing."""
    data = data_folder() / "med7"
    log = data / "med7_measurements.parquet"
    robot = drafted(data / "med7dock.urdf", log, folder)
    run("check", robot, log, "--fix", folder / "fixed.toml")
    fit, unseen = [f"{log}@0:10.5"], f"{log}@10.5:16.5"
    return [error(folder / "fixed.toml", fit, unseen, "Med7, after check --fix", None)]


def main() -> list[Claim]:
    """All of them."""
    claims = []
    for robot in (ur10, lwa3, med7):
        with tempfile.TemporaryDirectory() as folder:
            claims += robot(Path(folder))
    return claims


if __name__ == "__main__":
    main_of(main)
