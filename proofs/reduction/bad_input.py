"""What `steelyard reduce` refuses: a sentence that says what, where and how to correct it."""

import subprocess
import sys
import tempfile
from pathlib import Path

from proofs.reduction.ur10e import ROBOT
from proofs.robots.scores import ur10e_logs
from proofs.support.claims import Claim, data_folder, main_of

import steelyard

CASES = (
    ("a stretch too short to leave a part out", ("@5:6.2",), ()),
    ("a tolerance of zero", (), ("--stop", "tolerance=0")),
    ("a negative tolerance", (), ("--stop", "tolerance=-5")),
    ("--keep that matches nothing", (), ("--keep", "vicous.*")),
    ("--drop that matches nothing", (), ("--drop", "nothing")),
    ("everything essential", (), ("--keep", "*")),
    ("kept and removed", (), ("--keep", "offset.*", "--drop", "offset.*")),
    ("an unreachable condition number", (), ("--stop", "condition=0.9")),
    ("more parameters than there are", (), ("--stop", "count=99")),
    ("no such criterion", (), ("--criterion", "worth")),
    ("no such rule", (), ("--stop", "when_it_is_good")),
    ("bodies without a robot file", (), ("--bodies",)),
    ("a robot file of another robot", (), ("--bodies", "--robot", "panda.toml")),
)


def main() -> list[Claim]:
    """Every case by the command line; and a model that is reduced already is reduced further."""
    data_folder()
    claims = []
    log = ur10e_logs()[1]
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        steelyard.identify(ROBOT, log, method="WLS", check=False).save(folder / "model")
        for number, (name, cuts, options) in enumerate(CASES):
            given = [o if o != "panda.toml" else ROBOT.replace("ur10e", "panda") for o in options]
            out = folder / f"out{number}"
            command = [sys.executable, "-m", "steelyard", "reduce", str(folder / "model")]
            command += [log + "".join(cuts), *given, "-o", str(out)]
            done = subprocess.run(command, capture_output=True, text=True)
            first = (done.stderr or done.stdout).strip().splitlines()[:1]
            good = done.returncode == 2 and "fix" in done.stderr and "Traceback" not in done.stderr
            claims.append(
                Claim(name, " ".join(first)[:110], "refused, with a fix", good and not out.exists())
            )
        once = steelyard.reduce(folder / "model", log, stop="one_fewer")
        twice = steelyard.reduce(once.model, log, stop="one_fewer")
        told = (
            f"{len(once.model.estimate.removed)}, then {len(twice.model.estimate.removed)} removed"
        )
        further = len(twice.model.estimate.removed) == 2
        claims.append(Claim("a model that is reduced already", told, "reduced further", further))
    return claims


if __name__ == "__main__":
    main_of(main)
