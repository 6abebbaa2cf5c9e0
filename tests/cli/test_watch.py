"""`steelyard watch`: what it prints, writes and refuses."""

import csv
import json
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import steelyard
from cli.conftest import Command
from cli.interrupted_at import press_at
from cli.mistakes import leftovers
from cli.test_contact import PUSH, changed, columns
from steelyard.cli import interrupt
from steelyard.cli.app import app
from steelyard.cli.main import main
from steelyard.runs.runs_of_named_logs import log_files
from steelyard.uses.watch.watch import start_watch, stream_trace

AT_ONCE = ("--timeout", "0")

LENGTH = 2.5
"""Of the log [s]."""


@pytest.fixture(scope="module")
def pushed(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The start of the validation log, a push on the second link: joints 1 and 2 feel it."""
    log = given / "validation.csv"
    t, efforts = columns(log)
    push = 25.0 * ((t > PUSH[0]) & (t < PUSH[1]))
    folder = tmp_path_factory.mktemp("watched")
    whole = changed(log, folder / "whole.csv", {efforts[0]: 0.8 * push, efforts[1]: push})
    head = whole.read_text().splitlines()[: 1 + int(np.searchsorted(t, LENGTH))]
    path = folder / "pushed.csv"
    path.write_text("\n".join(head) + "\n")
    return path


def printed(output: str, event: str) -> list[dict[str, Any]]:
    return [one for one in map(json.loads, output.splitlines()) if one["event"] == event]


def table(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_push_is_printed_as_it_comes_and_written(
    pushed: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    model = steelyard.load_model(identified)
    frame, joints = model.robot.bodies[-1].name, model.joints
    options = ("--frame", frame, "-o", tmp_path / "out", "--json", *AT_ONCE)
    done = command("watch", identified, "--from", pushed, *options)
    assert done.exit_code == 0, done.output
    (start,), (end,) = printed(done.stdout, "contact"), printed(done.stdout, "contact_end")
    assert 0.0 <= start["time_s"] - PUSH[0] < 0.15 and end["start_s"] == start["time_s"]
    assert -0.02 < end["end_s"] - PUSH[1] < 0.2
    assert {load["joint"] for load in end["joints"]} == set(joints[:2])
    (begun,), (summary,) = printed(done.stdout, "start"), printed(done.stdout, "summary")
    assert begun["joints"] == list(joints) and begun["frame"] == frame
    assert summary["contacts"] == 1 and summary["payload_changes"] == 0
    (row,) = table(tmp_path / "out" / "events.csv")
    assert row["event"] == "contact" and float(row["end_s"]) == pytest.approx(end["end_s"])
    assert float(row["value"]) == pytest.approx(end["joints"][0]["peak"])
    estimates = table(tmp_path / "out" / "estimates.csv")
    at = [float(one["time_s"]) for one in estimates]
    inside = [k for k, t in enumerate(at) if PUSH[0] + 0.25 < t < PUSH[1]]
    felt = np.mean([float(estimates[k][f"torque.{joints[1]}"]) for k in inside])
    assert felt == pytest.approx(-25.0, rel=0.2)
    assert len(at) > 50 and at[-1] == pytest.approx(summary["duration_s"], abs=0.1)
    assert float(estimates[inside[0]]["half_width.fx_N"]) > 0.0


@pytest.mark.slow
def test_standard_input_gives_the_same_as_the_file(
    pushed: Path, identified: Path, command: Command
) -> None:
    text = pushed.read_text()
    names, *lines = text.splitlines()
    objects = "\n".join(
        json.dumps(dict(zip(names.split(","), map(float, line.split(",")), strict=True)))
        for line in lines
    )
    wanted = command("watch", identified, "--from", pushed, *AT_ONCE).stdout
    for given in (text, objects + "\n"):
        arguments = ["watch", str(identified), "--from", "-"]
        done = CliRunner().invoke(app, arguments, input=given)
        assert done.exit_code == 0, done.output
        assert done.stdout == wanted
    assert "1 contact, no changes of the payload" in " ".join(wanted.split())
    assert "calibrate with logs that were recorded like the stream" in wanted


@pytest.mark.slow
def test_estimates_are_printed_on_request(pushed: Path, identified: Path, command: Command) -> None:
    done = command("watch", identified, "--from", pushed, "--every", "0.5", "--json", *AT_ONCE)
    found = printed(done.stdout, "estimate")
    steps = np.diff([one["time_s"] for one in found])
    assert np.allclose(steps, 0.5, atol=0.02) and "wrench" not in found[0]
    lines = command("watch", identified, "--from", pushed, "--every", "0.5", *AT_ONCE).stdout
    assert lines.count("estimate   torque") == len(found)


def test_broken_rows_are_said_once_and_counted(
    pushed: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    lines = pushed.read_text().splitlines()
    for k in (100, 101, 102):
        lines[k] = lines[k].rpartition(",")[0] + ",nan"
    del lines[200:260]
    path = tmp_path / "broken.csv"
    path.write_text("\n".join([*lines, "3.0,1"]))
    done = command("watch", identified, "--from", path, "--json", *AT_ONCE)
    assert done.exit_code == 0, done.output
    notes = [one["text"] for one in printed(done.stdout, "note")]
    assert sum("not a number" in note for note in notes) == 1
    assert sum("the observer begins anew" in note for note in notes) == 1
    (summary,) = printed(done.stdout, "summary")
    assert summary["dropped_rows"] == {"a cell that is missing or not a number": 4}
    assert summary["gaps"] == 2


@pytest.mark.slow
def test_other_efforts_are_noted_once_and_in_the_summary(
    given: Path, pushed: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    log = given / "identification.csv"
    _, efforts = columns(log)
    header, *rows = log.read_text().splitlines()
    names = header.split(",")
    values = np.array([row.split(",") for row in rows], dtype=float)
    values[:, [names.index(name) for name in efforts]] *= -1.0
    path = tmp_path / "reversed.csv"
    lines = (",".join(f"{x:.9g}" for x in row) for row in values)
    path.write_text("\n".join([header, *lines]))
    done = command("watch", identified, "--from", path, "--json", *AT_ONCE)
    assert done.exit_code == 0, done.output
    notes = [one["text"] for one in printed(done.stdout, "note")]
    assert sum("are likelier than contact" in note for note in notes) == 1
    (summary,) = printed(done.stdout, "summary")
    assert "the model explains 0 % of the squared efforts" in summary["doubt"]
    text = command("watch", identified, "--from", path, *AT_ONCE).stdout
    assert text.count("are likelier than contact") == 2
    free = command("watch", identified, "--from", pushed, "--json", *AT_ONCE).stdout
    assert printed(free, "summary")[0]["doubt"] is None


def test_a_stream_without_usable_rows_is_an_error(
    pushed: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    header, *rows = pushed.read_text().splitlines()
    path = tmp_path / "backwards.csv"
    path.write_text("\n".join([header, *rows[::-1]]))
    done = command("watch", identified, "--from", path, *AT_ONCE)
    assert done.exit_code == 2 and "no contacts" not in done.stdout
    words = f"nothing was watched: {len(rows) - 1} of {len(rows)} rows are left out ("
    assert words in done.stderr and "with a time stamp before the previous one" in done.stderr


@pytest.mark.slow
def test_calibration_on_logs_of_the_stream(
    given: Path, pushed: Path, identified: Path, command: Command
) -> None:
    free = given / "validation.csv"
    quiet = command("watch", identified, "--from", free, "--calibrate", free, "--json", *AT_ONCE)
    assert quiet.exit_code == 0, quiet.output
    (begun,) = printed(quiet.stdout, "start")
    assert begun["thresholds"]["false_alarms_per_hour"] > 1.0
    assert "1 calibration log" in begun["notes"][0]
    found = command("watch", identified, "--from", pushed, "--calibrate", free, *AT_ONCE)
    assert "1 contact, " in found.stdout
    trace = stream_trace(steelyard.load_model(identified), log_files([str(free)])[0], 8.0)
    limits = np.array(begun["thresholds"]["thresholds"], dtype=float)
    assert np.nanmax(np.abs(trace.residual)) < np.nanmax(limits)


def test_a_model_without_left_out_motion_seeks_no_contact(identified: Path) -> None:
    model = steelyard.load_model(identified)
    begun = start_watch(model, bandwidth=3.0)
    assert begun.watcher.thresholds is None and "contact is not sought" in begun.notes[0]
    with pytest.raises(steelyard.SteelyardError, match="nothing to calibrate thresholds with"):
        start_watch(model, bandwidth=3.0, rate=5.0)


@pytest.mark.slow
def test_ctrl_c_ends_with_a_summary(
    pushed: Path,
    identified: Path,
    work: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ["watch", str(identified), "--from", str(pushed), "-o", str(work / "out")]
    monkeypatch.setattr(sys, "argv", ["steelyard", *arguments])
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(interrupt, "_state", interrupt._State())
    before = signal.getsignal(signal.SIGINT)
    press_at("watch_command._Arrival.waiting", {})
    try:
        with pytest.raises(SystemExit) as end:
            main()
    finally:
        sys.settrace(None)
        signal.signal(signal.SIGINT, before)
    assert end.value.code in (0, None)
    shown = capsys.readouterr().out
    assert "1 contact, no changes of the payload" in shown and "written" in shown
    assert len(table(work / "out" / "events.csv")) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--from", "gone.csv", "-o", "out"), "there is no such file"),
        (("--from", "-", "--timeout", "1"), "standard input ends when its writer"),
        (("--from", "{log}", "--frame", "nose", *AT_ONCE), "no frame 'nose'"),
        (("--from", "{log}", "--calibrate", "{fitted}"), "all calibration logs were fitted"),
        (("--from", "{log}", "--bandwidth", "200", *AT_ONCE), "samples a second"),
        (("--from", "{log}", "-o", "../given"), "exists already"),
        (("--from", "{robot}", *AT_ONCE), "cannot be read while it is written"),
    ],
)
def test_mistakes(
    arguments: tuple[str, ...],
    words: str,
    given: Path,
    pushed: Path,
    identified: Path,
    command: Command,
    work: Path,
) -> None:
    files = {
        "log": pushed, "fitted": given / "identification.csv", "robot": given / "demo_arm.toml"
    }  # fmt: skip
    done = command("watch", identified, *(a.format(**files) for a in arguments))
    assert done.exit_code == 2 and words in done.stderr
    assert leftovers(work) == []


def test_help_shows_an_example(command: Command) -> None:
    assert "Example: steelyard watch" in command("watch", "--help").stdout
