"""`steelyard excite`: its files, its options, earlier logs, and Ctrl-C."""

import hashlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np
import polars as pl
import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF
from typer.testing import CliRunner, Result

from cli.mistakes import PLAIN
from excite.tabled import OPEN, QUICK, arm, searching_here
from steelyard.cli.app import app
from steelyard.cli.options_with_several_values import expanded
from steelyard.excite.search import parallel_search
from steelyard.excite.trajectories.trajectory_files import read_motion

FREE = f'{OPEN}without = ["tool"]\n[excitation.limits]\neffort = "any"\n'
ANY = f'{FREE}[excitation.workspace]\nwithout = ["tool"]\nfloor = -5.0\n'
BRIEF = QUICK.replace("harmonics = 3", "harmonics = 2")
"""A motion whose first search ends soon."""

ONE = ("--searches", "1", "--processes", "1", "--budget", "60")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, expanded([str(a) for a in arguments]))


def ran(*arguments: object) -> Result:
    done = run(*arguments)
    assert done.exit_code == 0, done.output
    return done


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an arm, a design and the terminal's output."""
    folder = tmp_path_factory.mktemp("excite")
    arm(folder, ANY + QUICK)
    formats = ("--format", "ros2", "mujoco")
    with patch.object(parallel_search, "_workers", searching_here):
        done = ran("excite", folder / "arm.toml", *ONE, *formats, "-o", folder / "out")
    (folder / "output.txt").write_text(done.stdout)
    return folder


def test_files(made: Path) -> None:
    names = {path.name for path in (made / "out").iterdir()}
    assert names == {
        "trajectory.json",
        "certificate.json",
        "trajectory.csv",
        "trajectory.yaml",
        "trajectory.xml",
        "report.html",
    }
    text = (made / "output.txt").read_text()
    assert all(name in text for name in names)
    assert "every checked limit is proven to hold at all times" in " ".join(text.split())


def test_the_certificate_is_of_this_trajectory(made: Path) -> None:
    certificate = json.loads((made / "out" / "certificate.json").read_text())
    values = json.loads((made / "out" / "trajectory.json").read_text())
    assert values.pop("joints") == ["tower_joint", "boom_joint", "stick_joint"]
    text = json.dumps(values, sort_keys=True)
    assert certificate["trajectory_sha256"] == hashlib.sha256(text.encode()).hexdigest()
    assert certificate["holds"] is True
    assert any("accelerations are kept below" in note for note in certificate["notes"])
    assert "<h3>Assumed</h3>" in (made / "out" / "report.html").read_text()


def test_simulate_follows_the_design(made: Path) -> None:
    motion = made / "out" / "trajectory.json"
    ran("simulate", made / "arm.toml", "--motion", motion, "-o", made / "trial")
    again = read_motion(made / "trial" / "trajectory.json", arm(made, ANY + QUICK).robot)
    t = np.linspace(0.0, 4.0, 40)
    first = read_motion(motion, arm(made, ANY + QUICK).robot)
    np.testing.assert_array_equal(again.derivative(t, 0), first.derivative(t, 0))


def test_a_folder_is_never_overwritten(made: Path) -> None:
    before = (made / "out" / "trajectory.json").read_bytes()
    done = run("excite", made / "arm.toml", *ONE, "-o", made / "out")
    assert done.exit_code == 2 and "exists already" in done.output
    assert (made / "out" / "trajectory.json").read_bytes() == before


@pytest.mark.slow
def test_json(made: Path) -> None:
    out = made / "planned"
    options = ("--motion", "sweeps", "--json", "-o", out)
    done = ran("excite", made / "arm.toml", *options)
    found = json.loads(done.stdout, parse_constant=lambda text: pytest.fail(text))
    assert found["certified"] is True and found["motion"] == "sweeps"
    assert found["figure"] is None and None in found["predicted_std"].values()
    assert set(found["files"]) == {"trajectory", "certificate", "csv", "report"}
    assert all(Path(path).is_file() for path in found["files"].values())


@pytest.mark.slow
@pytest.mark.usefixtures("searches_here")
def test_options_take_the_place_of_tables(made: Path) -> None:
    options = ("--motion", "raw_fourier", "--period", "5", "--harmonics", "2", "--seed", "3")
    more = ("--criterion", "d_optimal", "--method", "gradient", "--rate", "100", "--json")
    done = ran("excite", made / "arm.toml", *ONE, *options, *more, "-o", made / "other")
    found = json.loads(done.stdout)
    assert (found["motion"], found["duration_s"]) == ("raw_fourier", 5.0)
    assert "D-optimality" in found["criterion"] and "assumed" in found["noise"]
    values = json.loads((made / "other" / "trajectory.json").read_text())
    assert len(values["sine"][0]) == 2 or len(values["sine"]) == 2
    rows = (made / "other" / "trajectory.csv").read_text().splitlines()
    assert len(rows) == pytest.approx(5.0 * 100.0, abs=3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--motion", "fourer"), "there is no motion 'fourer', but fourier"),
        (("--motion", "sweeps", "--period", "3"), "a motion of kind 'sweeps' has no period"),
        (("--motion", "spline", "--harmonics", "3"), "a motion of kind 'spline' has no harmonics"),
        (("--motion", "replay"), "motion.file: is missing"),
        (("--harmonics", "1"), "motion.harmonics: input should be greater than or equal to 2"),
        (("--period", "-1"), "motion.period: input should be greater than 0"),
        (("--criterion", "best"), "there is no criterion 'best'"),
        (("--method", "newton"), "there is no search method 'newton'"),
        (("--still-unknown",), "add --earlier MODEL.json"),
        (("--format", "ursript"), "did you mean 'urscript'?"),
        (("--format", "urscript"), "six revolute joints"),
        (("--motion", "raw_fourier", "--format", "ros2"), "at rest"),
        (("--earlier", "nothing.json"), "cannot be read"),
    ],
)
def test_options_that_do_not_fit(made: Path, options: tuple[str, ...], words: str) -> None:
    start = time.process_time()
    out = made / "wrong"
    done = run("excite", made / "arm.toml", *ONE, *options, "-o", out)
    assert done.exit_code == 2 and not out.exists()
    assert words in " ".join(done.output.split())
    assert time.process_time() - start < 3.0


def test_a_planned_motion_that_does_not_keep_everything(tmp_path: Path) -> None:
    box = "box = {z = [0.5, 0.6]}\n"
    arm(tmp_path, f'{ANY}{box}[excitation.motion]\nkind = "postures"\ncount = 3\n')
    done = run("excite", tmp_path / "arm.toml", "--format", "ros2", "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert "not written  ros2: the motion is not proven" in done.output
    assert not (tmp_path / "out" / "trajectory.yaml").exists()
    assert "not proven" in done.output and (tmp_path / "out" / "report.html").is_file()
    assert "z of 'tool' above 0.5 m" in (tmp_path / "out" / "certificate.json").read_text()


@pytest.mark.slow
def test_what_is_not_covered_has_an_exit_code_of_its_own(tmp_path: Path) -> None:
    arm(tmp_path, f'{FREE}[excitation.motion]\nkind = "sweeps"\n')
    done = run("excite", tmp_path / "arm.toml", "--format", "ros2", "-o", tmp_path / "out")
    assert done.exit_code == 3 and (tmp_path / "out" / "trajectory.yaml").is_file()
    words = " ".join(done.output.split())
    assert "every checked limit is proven" in words
    assert "not covered: no floor or cell is defined for the links" in words
    as_json = run("excite", tmp_path / "arm.toml", "--json", "-o", tmp_path / "json")
    found = json.loads(as_json.stdout)
    assert as_json.exit_code == 3 and found["certified"] is True
    (gap,) = found["not_covered"]
    assert "floor = 0.0" in gap and len(found["not_covered_as_asked"]) == 2
    assert "not covered are the approach to the start posture" in found["covers"]


def test_too_few_points_for_a_wall_are_not_covered(tmp_path: Path) -> None:
    wall = "box = {z = [-0.34, 3.0]}\n[excitation.motion]\nkind = 'sweeps'\nspeeds = 2\n"
    arm(tmp_path, ANY + wall)
    start = ("excite", tmp_path / "arm.toml", "--json")
    few = run(*start, "--rate", "1", "-o", tmp_path / "few")
    assert few.exit_code == 3, few.output
    (gap,) = json.loads(few.stdout)["not_covered"]
    assert re.search(r"csv has 1 points per second; .* mm: .*; --rate \d+ is enough", gap)
    assert gap in json.loads((tmp_path / "few" / "certificate.json").read_text())["not_covered"]
    enough = gap.split("--rate ")[1].split()[0]
    ran(*start, "--rate", enough, "-o", tmp_path / "enough")


@pytest.mark.slow
def test_the_headline_says_what_the_box_is_about(made: Path) -> None:
    box = "box = {z = [-3.0, 3.0]}\n[excitation.motion]\nkind = 'sweeps'\n"
    arm(made, ANY + box)
    found = json.loads(ran("excite", made / "arm.toml", "--json", "-o", made / "boxed").stdout)
    arm(made, ANY + QUICK)
    assert "tool box (tool point only)" in found["limits"]
    assert "floor, planes and boxes (all links but tool, tool and loads" in found["limits"]


SIGNALS = """
[signals]
time = "time_s"
position = "q{}_rad"
velocity = "dq{}_rad_s"
[signals.effort]
columns = "tau{}_Nm"
kind = "joint_torque"
unit = "Nm"
"""


@pytest.mark.slow
@pytest.mark.usefixtures("searches_here")
def test_after_an_earlier_log(tmp_path: Path) -> None:
    arm(tmp_path, ANY + QUICK + SIGNALS)
    robot, folder = tmp_path / "arm.toml", tmp_path
    ran("simulate", robot, "--period", "6", "-o", folder / "first")
    (log,) = (folder / "first").glob("*.csv")
    ran("identify", robot, log, *PLAIN, "-o", folder / "known")
    base = ("excite", robot, *ONE, "--criterion", "a_optimal", "--json")
    alone = json.loads(ran(*base, "--earlier", folder / "known", "-o", folder / "out").stdout)
    assert "earlier log" in alone["noise"]
    options = ("--earlier", folder / "known/model.json", "--still-unknown")
    after = json.loads(ran(*base, *options, "-o", folder / "after").stdout)
    known = json.loads((folder / "known" / "model.json").read_text())["estimate"]
    before = dict(zip(known["names"], np.sqrt(np.diag(known["covariance"])), strict=True))
    for name, std in after["predicted_std"].items():
        assert 0.0 < std <= before.get(name, np.inf) * (1.0 + 1e-9)
    first, both = (
        sum(std**2 for std in found["predicted_std"].values()) for found in (alone, after)
    )
    assert both < first


def test_an_earlier_model_of_another_robot(tmp_path: Path, identified: Path) -> None:
    arm(tmp_path, ANY + QUICK)
    options = ("--earlier", identified, "-o", tmp_path / "out")
    done = run("excite", tmp_path / "arm.toml", *ONE, *options)
    assert done.exit_code == 2
    assert "the earlier model moves the joints" in done.output


def started(folder: Path, *options: str, terminal: int | None = None) -> "subprocess.Popen[str]":
    """The command as a program, with a long budget, leader of a group of its own."""
    arm(folder, ANY + BRIEF)
    command = [sys.executable, "-m", "steelyard", "excite", "arm.toml", "-o", "out"]
    budget = () if "--budget" in options else ("--budget", "120")
    processes = () if "--processes" in options else ("--processes", "1")
    return subprocess.Popen(
        [*command, *processes, *budget, *options],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE if terminal is None else terminal,
        text=True,
        start_new_session=True,
    )


def searching(process: "subprocess.Popen[str]") -> list[str]:
    """Processes of a command that search, while it lives or after."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes()
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except OSError:
            continue
        if b"search.parallel_search" in words and int(parent) == process.pid:
            found.append(folder.name)
    return found


def gone(names: list[str]) -> bool:
    """Whether processes are gone, now or in a moment: they end when nobody reads them."""
    limit = time.monotonic() + 10.0
    while any(Path("/proc", name).exists() for name in names):
        if time.monotonic() > limit:
            return False
        time.sleep(0.05)
    return True


def wait_for(process: "subprocess.Popen[str]") -> list[str]:
    while not (names := searching(process)) and process.poll() is None:
        time.sleep(0.1)  # to look at all processes takes 20 ms
    return names


def worked(names: list[str]) -> float:
    """Processor seconds that the processes have used: how far they are, on a busy machine too."""
    ticks = 0
    for name in names:
        fields = Path("/proc", name, "stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


linux = pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes in /proc")


def best_found(process: "subprocess.Popen[str]", terminal: int) -> bool:
    """Wait until the bar in a terminal shows the best motion so far; whether it did."""
    shown = b""
    while b"best" not in shown and process.poll() is None:
        shown += os.read(terminal, 4096)
    return b"best" in shown


@pytest.mark.slow
@linux
def test_ctrl_c_in_a_terminal_keeps_the_best_so_far(tmp_path: Path) -> None:
    """The bar shows the best so far; Ctrl-C, for the whole group, ends all processes."""
    ours, theirs = pty.openpty()
    process = started(tmp_path, "--json", "--processes", "2", terminal=theirs)
    os.close(theirs)
    names = wait_for(process)
    assert best_found(process, ours)
    os.killpg(process.pid, signal.SIGINT)
    assert process.stdout is not None
    found = json.loads(process.stdout.read())
    assert process.wait(timeout=30) == 0
    os.close(ours)
    process.stdout.close()
    assert found["stopped"] and found["certified"]
    assert (tmp_path / "out" / "trajectory.json").is_file()
    assert "stopped early" in (tmp_path / "out" / "report.html").read_text()
    assert names and gone(names)


@pytest.mark.slow
@linux
def test_ctrl_c_twice_leaves_nothing(tmp_path: Path) -> None:
    process = started(tmp_path)
    names = wait_for(process)
    while worked(names) < 2.0:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (130, "stopped: nothing was written\n")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["arm.toml", "arm.urdf"]
    assert gone(names)


def test_of_targets_the_accuracy_is_said_to_be_another_ones(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    (tmp_path / "servos.toml").write_text(ROBOT_FILE)
    arguments = [str(tmp_path / "servos.toml"), "--motion", "sweeps", "--rate", "50", "--json"]
    done = CliRunner().invoke(app, ["excite", *arguments, "-o", str(tmp_path / "out")])
    assert "names position targets" in json.loads(done.stdout)["notes"][-1]
    times = pl.read_csv(tmp_path / "out" / "trajectory.csv")["time_s"]
    assert times.diff()[1] == pytest.approx(0.02)
