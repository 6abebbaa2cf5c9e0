"""What all studies share, and their pages; `proofs/studies/quick.py` runs the studies."""

import os
import re
import runpy
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import steelyard

sys.path.append(str(Path(__file__).parent.parent))
from studies.support.page import Table, above, over_seeds
from studies.support.picture import HEIGHT, WIDTH, Curve, Panel, Picture
from studies.support.robots import robot_file

ROOT = Path(__file__).parent.parent
STUDIES = sorted((ROOT / "studies").glob("p[1-9]_*.py"))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


def started(study: Path, *options: str, data: Path | None = None) -> "subprocess.Popen[str]":
    path = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    return subprocess.Popen(
        [sys.executable, str(study), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": path,
            "OMP_NUM_THREADS": "1",
            "STEELYARD_DATA": str(data or ""),
        },
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # not in a background job
    )


def found(name: str, folder: Path, out: str) -> None:
    """What a study prints and writes."""
    assert "Bounds" in out and not re.search(r"\bNO$", out, re.MULTILINE)
    page = (folder / f"{name}.html").read_text(encoding="utf-8")
    markdown = (folder / f"{name}.md").read_text(encoding="utf-8")
    pictures = re.findall(r"\]\((.+?\.svg)\)", markdown)
    assert page.count("<svg") == len(pictures) > 0
    tables = re.findall(r"^\| --- \|", markdown, re.MULTILINE)
    assert page.count("<table>") == len(tables) >= 2
    assert all((folder / picture).is_file() for picture in pictures)
    assert any((folder / "seed_00").iterdir())


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: path.stem)
def test_the_documentation_lists_it(study: Path) -> None:
    assert f"`studies/{study.name}`" in (ROOT / "docs/studies/index.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: path.stem)
def test_every_bound_is_a_proof(study: Path) -> None:
    proof = ROOT / "proofs" / "studies" / f"{study.stem.split('_')[0]}.py"
    assert f"from studies.{study.stem} import STUDY" in proof.read_text(encoding="utf-8")


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: path.stem)
def test_a_study_uses_the_public_interface_alone(study: Path) -> None:
    text = study.read_text(encoding="utf-8")
    assert not re.findall(r"(?:from|import) steelyard\.\w+", text)


def test_an_existing_folder_is_not_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kept.txt").write_text("mine")
    monkeypatch.setattr("sys.argv", [str(STUDIES[0]), "-o", str(tmp_path), "--quick"])
    with pytest.raises(SystemExit, match="exists already; give a new folder"):
        runpy.run_path(str(STUDIES[0]), run_name="__main__")
    assert [path.name for path in tmp_path.iterdir()] == ["kept.txt"]


SQUARES = """
from studies.support.page import Claim, Page, Section, Table
from studies.support.picture import Curve, Panel, Picture
from studies.support.study import Study, run
import numpy as np

def one(folder, seed, quick):
    (folder / "number.txt").write_text(str(seed))
    return np.array([seed, seed**2 + 1])

def page(found):
    rows = tuple((str(seed), str(square)) for seed, square in found)
    x, y = np.array(found, dtype=float).T
    picture = Picture("squares", "", (Panel("", "", "", (Curve("", x, y),)),))
    return Page("Squares", (Table("Squares", rows, ("", "")), picture), (Claim("", "", "", True),))

def measured(folder, quick):
    (folder / "robot.txt").write_text("real")
    table = Table("Measured", (("a robot", str(quick)),), ("", ""))
    return Section((table,), (Claim("a bound of its own", "", "", True),))

if __name__ == "__main__":
    run(Study("p9", one, page, measured))
"""


@pytest.mark.slow
@pytest.mark.parametrize("there", [True, False], ids=["with data", "without data"])
def test_a_study_is_a_program_with_processes_of_its_own(tmp_path: Path, there: bool) -> None:
    script = tmp_path / "squares.py"
    script.write_text(SQUARES)
    data = tmp_path if there else tmp_path / "missing"
    run = started(script, "-o", str(tmp_path / "out"), "--seeds", "3", data=data)
    out, err = run.communicate()
    assert run.returncode == 0, out + err
    found("p9", tmp_path / "out", out)
    assert re.search(r"0 +1\n1 +2\n2 +5\n", out) and "p9: seed 3 of 3" in err
    assert (re.search(r"a robot +False\n", out) is not None) == there
    assert ("a bound of its own" in out) == there
    assert (tmp_path / "out" / "measured" / "robot.txt").is_file() == there
    page = (tmp_path / "out" / "p9.md").read_text(encoding="utf-8")
    assert ("set STEELYARD_DATA to the folder" in page) != there


ENDLESS = """
import os
import threading
from studies.support.page import Page
from studies.support.study import Study, run

def one(folder, seed, quick):
    os.write(1, b"working\\n")
    threading.Event().wait()

def page(found):
    return Page("", (), ())

if __name__ == "__main__":
    run(Study("p9", one, page))
"""


@pytest.mark.slow
def test_an_interrupt_ends_all_processes_and_writes_nothing(tmp_path: Path) -> None:
    script = tmp_path / "endless.py"
    script.write_text(ENDLESS)
    run = started(script, "-o", str(tmp_path / "out"), "--seeds", "2")
    assert run.stdout is not None
    assert [run.stdout.readline() for _ in range(2)] == ["working\n"] * 2
    run.send_signal(signal.SIGINT)
    _, err = run.communicate()  # returns when no process holds the pipe any more
    assert run.returncode == 1 and err.strip() == "stopped; nothing was written"
    assert not (tmp_path / "out").exists()


def test_tables_merge_into_a_robot_file(tmp_path: Path) -> None:
    changes = """
        [robot.limits]
        elbow = { lower = -1.0, upper = 1.0, velocity = 1.0 }
        [excitation.motion]
        kind = "sweeps"
    """
    loaded = steelyard.load_robot(robot_file("p4_arm", tmp_path / "arm.toml", changes))
    limits = {joint.name: joint.limits.upper for joint in loaded.robot.joints}
    assert limits["elbow"] == 1.0 and limits["wrist3"] == 2.6
    assert loaded.excitation.motion.kind == "sweeps"


def test_tables_and_numbers() -> None:
    assert over_seeds([2.0, 1.0, 4.0], "%") == "2 (1 to 4) %"
    assert over_seeds([0.12345], digits=2) == "0.12"
    assert over_seeds([2.0, float("nan"), 1.0], "m") == "1.5 (1 to 2) m, in 2 of 3 seeds"
    assert over_seeds([float("nan")]) == "in no seed"
    assert above([0.1, 0.6, float("nan")], 0.5) == "; above in seed 1: 0.6"
    assert above([0.1], 0.5) == ""
    with pytest.raises(ValueError, match="lacks cells"):
        Table("errors", (("a", "b"),))


def test_a_picture_has_all_of_its_curves_inside() -> None:
    x = np.linspace(0.0, 1.0, 1000)
    curves = (Curve("up", x, 10.0 ** (3.0 * x)), Curve("dots", x[:5], x[:5] + 1.0, points=True))
    panel = Panel("growth", "time [s]", "size < 1", curves, log=True)
    svg = Picture("one", "a & b", (panel, panel, panel)).svg()
    root = ElementTree.fromstring(svg)
    assert root.attrib["viewBox"] == f"0 0 {2 * WIDTH} {2 * HEIGHT}"
    lines = root.findall(".//{*}polyline")
    assert len(lines) == 3 and len(root.findall(".//{*}circle")) == 15
    points = np.array([pair.split(",") for pair in lines[0].attrib["points"].split()], dtype=float)
    assert len(points) <= 201 and (np.diff(points[:, 0]) > 0.0).all()
    assert (points >= 0.0).all() and (points <= [WIDTH, HEIGHT]).all()
    texts = {node.text for node in root.findall(".//{*}text")}
    assert {"growth", "size < 1", "up", "1", "10", "100", "1000"} <= texts
