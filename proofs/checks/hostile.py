"""Twelve hostile inputs, each a script that uses the command `steelyard` and prints what it says.

They lie in the folder `hostile` beside that of `STEELYARD_DATA`, with what is right. Run by itself
it takes names of folders: `python -m proofs.checks.hostile scara_gravity`. One needs to mount a
small disk, so the rights of root.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from proofs.support.claims import Claim, data_folder, main_of
from scipy.stats import poisson

LEVELS = re.compile(r"\b(GOOD|FAIR|POOR):")
SURE = 0.01
"""Probability of as many alarms by chance, below which a stated rate is not kept."""


def terminal_escape(said: str) -> bool:
    """A column's name that would overwrite the verdict is printed as text."""
    return "^[" not in said and r"x\x1b" in said


def mjcf_devices(said: str) -> bool:
    """Devices, pipes and counts that fill the memory: refused in time, each with advice."""
    return said.count("exit 2") == said.count("fix ") == 5


def disk_full(said: str) -> bool:
    """The same message for every format."""
    return said.count("exit 2") == said.count("the space left") == 4


def mcap_definitions(said: str) -> bool:
    """Little memory, and soon."""
    found = re.findall(r"(\d+) KiB, ([\d.]+) s", said)
    return len(found) == 2 and all(int(a) < 500_000 and float(b) < 15.0 for a, b in found)


def small_crashes(said: str) -> bool:
    """Messages, each with advice; the watch goes on behind a line that cannot be read."""
    ends = dict(re.findall(r"^(\w.{40,43})\s+exit (\d+)", said, re.M))
    fine = {name.strip() for name, code in ends.items() if code == "0"}
    return (
        "Traceback" not in said
        and len(ends) == 8
        and {x.split()[0] for x in fine}
        == {
            "npz",
            "watch:",
        }
    )


def lost_rows(said: str) -> bool:
    """Degrees are not written for any of five robots."""
    return len(re.findall(r"^\d exit 1 \[\] \| written: None$", said, re.M)) == 5


def frozen_encoder(said: str) -> bool:
    """Named, and no line is written that makes it worse."""
    return "its encoder is frozen" in " ".join(said.split()) and "No robot file is written" in said


def doubtful_good(said: str) -> bool:
    """What is doubtful or not decided stands below the headline, by default."""
    a, b, c = (line.partition("identify:")[2] for line in said.strip().splitlines()[-3:])
    return (
        "GOOD" not in a
        and "! check, computed efforts" in a
        and "! not decided by the logs" in b
        and ("heavier than in the model file" in c or "payload" in c)
    )


def named_causes(said: str) -> bool:
    """No payload where offsets jump; no event where a hose pulls."""
    events = [line for line in said.splitlines() if line.startswith("    !")]
    return not any("payload" in line for line in events) and len(LEVELS.findall(said)) == 4


def scara_gravity(said: str) -> bool:
    """What an offset absorbs is open."""
    parts = re.split(r"\| check exit", said)[1:]
    return len(parts) == 2 and all(re.search(r"open +.*(effort kind|mounting)", p) for p in parts)


def effort_scales(said: str) -> bool:
    """Intervals hold the truth."""
    found = re.search(r"coverage of 95 % intervals ([\d.]+)", said)
    return found is not None and float(found[1]) >= 90.0


def contact_rates(said: str) -> bool:
    """No more alarms in an hour, and in its pieces, than chance allows at the stated rates."""
    hour = dict(re.findall(r"'([\d.]+)': ([\d.]+)", said))
    pieces = re.search(r"(\d+) alarms in ([\d.]+) h", said)
    if len(hour) != 3 or pieces is None:
        return False
    counts = [(float(n), float(rate)) for rate, n in hour.items()]
    counts.append((float(pieces[1]), 6.0 * float(pieces[2])))
    return all(poisson.sf(n - 1, mean) > SURE for n, mean in counts)


SCRIPTS: dict[str, tuple[list[str], Callable[[str], bool]]] = {
    "terminal_escape": (["bash", "run.sh"], terminal_escape),
    "mjcf_devices": (["bash", "run.sh"], mjcf_devices),
    "disk_full_h5": (["bash", "run.sh"], disk_full),
    "mcap_definitions": ([sys.executable, "run.py"], mcap_definitions),
    "small_crashes": ([sys.executable, "run.py"], small_crashes),
    "fix_lost_rows": ([sys.executable, "run.py"], lost_rows),
    "fix_frozen_encoder": ([sys.executable, "run.py"], frozen_encoder),
    "doubtful_good": ([sys.executable, "run.py"], doubtful_good),
    "named_causes": ([sys.executable, "run.py"], named_causes),
    "scara_gravity": ([sys.executable, "run.py"], scara_gravity),
    "effort_scales": ([sys.executable, "scales.py"], effort_scales),
    "contact_rates": ([sys.executable, "rates.py", "1"], contact_rates),
}


def main(names: Sequence[str] = tuple(SCRIPTS)) -> list[Claim]:
    """One claim a script."""
    source = data_folder().parent / "hostile"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    claims = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "hostile"
        shutil.copytree(source, place)
        for name in names:
            command, is_right = SCRIPTS[name]
            done = subprocess.run(
                command,
                cwd=place / name,
                env={**os.environ, "PATH": path, "COLUMNS": "200"},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                check=False,
            )
            right = is_right(done.stdout)
            if not right:
                print(f"== {name}\n{done.stdout}", file=sys.stderr)
            claims.append(Claim(name, "right" if right else "wrong", "right", right))
    return claims


if __name__ == "__main__":
    main_of(lambda: main(tuple(sys.argv[1:]) or tuple(SCRIPTS)))
