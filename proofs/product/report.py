"""The UR10e report in headless Chromium: no console error, its sections there, all plots drawn.

So that most sections have content, drive gains are identified from a payload, friction is
chosen, and every run has an offset of its own.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from proofs.robots.scores import EXAMPLES, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, main_of

from steelyard.identify.scores_and_model_report import SECTIONS

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from browser import chromium, look, running  # noqa: E402

MEGABYTE = 2**20
ABSENT = {
    "reduction": "reduce",
    "removals": "reduce",
    "effort_scales": "no scale is estimated beside drive gains",
    "zero_offsets": "no zero offset is identified",
    "truth": "demo",
    "bootstrap": "--bootstrap",
    "repeated": "--each",
    "evolution": "a genetic estimator",
}
"""Sections that this identification does not have, and where they come from."""


def loaded_log() -> str:
    """The run with the payload of 2.805 kg."""
    return str(Path(ur10e_logs()[-1]).with_name("ur-20_02_19_14harm50secLoad.parquet"))


def _robot_file(folder: Path) -> Path:
    text = (EXAMPLES / "ur10e_auto.toml").read_text(encoding="utf-8")
    text = re.sub(r"gain = \[.*\]", 'gain = "identify"', text)
    terms = 'terms = ["rigid_body", "rotor_inertia", {law = "offset", per_run = true}]'
    file = folder / "ur10e.toml"
    file.write_text(text.replace("[model]", f"[model]\n{terms}"), encoding="utf-8")
    return file


def main() -> list[Claim]:
    """Identify, open the page, look at what is in it once it has run."""
    program = chromium()
    if program is None:
        return [Claim("a browser to look with", "none found", "Chromium", False)]
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "out"
        command = [sys.executable, "-m", "steelyard", "identify", "--sensitivity"]
        command.append(str(_robot_file(Path(name))))
        command += [*ur10e_logs(), "--loaded", loaded_log(), "--payload-mass", "2.805"]
        command += ["--validate", ur10e_validation(), "-o", str(out)]
        subprocess.run(command, check=True, capture_output=True)
        page = out / "report.html"
        size = page.stat().st_size / MEGABYTE
        html = page.read_text(encoding="utf-8")
        with running(program, Path(name)) as tab:
            seen = look(tab, page)
    there = {section.name for section in SECTIONS if f'<section id="{section.name}"' in seen.dom}
    due = {section.name for section in SECTIONS} - set(ABSENT)
    markup = re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)
    network = len(re.findall(r"(?:src|href)\s*=\s*[\"']?http", markup))
    quiet = not seen.console and not seen.errors
    return [
        Claim("console errors", f"{len(seen.console) + len(seen.errors)}", "0", quiet),
        Claim("sections", f"{len(there)} of {len(due)} that it has", "all", there == due),
        Claim("plots drawn, one a joint", f"{seen.drawn}", "6", seen.drawn == 6),
        Claim("size of the page", f"{size:.2f} MB", "<= 4 MB", size <= 4.0),
        Claim("links to the network", f"{network}", "0", network == 0),
    ]


if __name__ == "__main__":
    main_of(main)
