"""What a robot file leaves to the data or chooses otherwise, through whole identifications."""

import json
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import steelyard
from cli.conftest import Command
from cli.river_files import edited
from short_arm import short_logs
from steelyard.estimate.scores.cross_validation import TooShortError
from steelyard.identify.fit_preparation import TOO_SHORT

TERMS = 'terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]'
Identified = Callable[..., tuple[dict[str, Any], Path]]


@pytest.fixture
def identified(given: Path, tmp_path: Path, command: Command) -> Identified:
    """`identify --json` with the demo arm's robot file changed, and the folder it wrote."""

    def run(
        *changes: tuple[str, str], options: tuple[str, ...] = ()
    ) -> tuple[dict[str, Any], Path]:
        robot, out = edited(given, tmp_path, *changes), tmp_path / "out"
        logs = given / "identification.csv", "--validate", given / "validation.csv"
        done = command("identify", robot, *logs, "--no-check", "-o", out, "--json", *options)
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout), out

    return run


@pytest.fixture(scope="module")
def longer(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two logs that are long enough to compare friction laws."""
    folder = tmp_path_factory.mktemp("longer")
    short_logs(folder, period=3.0)
    return folder / "identification.csv", folder / "validation.csv"


@pytest.mark.slow
@pytest.mark.parametrize("selection", ["auto", "auto_memoryless"])
def test_memory_is_among_what_is_chosen_from_unless_excluded(
    selection: str, given: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def choose(*args: object, memory: bool, **kwargs: object) -> None:
        asked.append(memory)
        raise TooShortError("too short", where="", fix="")

    monkeypatch.setattr(
        import_module("steelyard.identify.fit_preparation"), "choose_friction", choose
    )
    terms = TERMS.replace('"coulomb", "viscous", ', "") + f'\nfriction = "{selection}"'
    robot, log = edited(given, tmp_path, (TERMS, terms)), given / "identification.csv"
    done = command("identify", robot, log, "--no-check", "-o", "out", "--method", "OLS", "--json")
    assert done.exit_code == 0, done.output
    assert asked == [selection == "auto"] and TOO_SHORT in json.loads(done.stdout)["notes"]


@pytest.mark.slow
def test_friction_is_chosen_and_reported(
    given: Path, longer: tuple[Path, Path], tmp_path: Path, command: Command
) -> None:
    terms = TERMS.replace('"coulomb", "viscous", ', "") + '\nfriction = "auto"'
    robot, out = edited(given, tmp_path, (TERMS, terms)), tmp_path / "out"
    done = command("identify", robot, *longer, "--no-check", "-o", out, "--json")
    assert done.exit_code == 0, done.output
    chosen = json.loads(done.stdout)
    table = chosen["friction"]["table"]
    assert [mix["chosen"] for mix in table].count(True) == 1
    assert chosen["friction"]["left_out"] == "run"
    assert any("dahl" in mix["mix"] or "maxwell_slip" in mix["mix"] for mix in table)
    best = next(mix for mix in table if mix["chosen"])
    assert best["mix"] == chosen["friction"]["chosen"]
    assert best["error_percent"] <= table[0]["error_percent"]
    laws = {term["law"] for term in chosen["terms"]}
    assert {"rigid_body", "rotor_inertia", "offset", "viscous"} < laws
    assert "load_dependent" not in laws  # joint torques: the gears' losses are not in them
    assert any(
        "friction chosen by cross-validation, leaving one run out" in note
        for note in chosen["notes"]
    )
    assert '<section id="friction"' in (out / "report.html").read_text(encoding="utf-8")
    assert {term.law for term in steelyard.load_model(out).model.terms} == laws


@pytest.mark.slow
def test_a_field_is_found_and_reported(identified: Identified) -> None:
    dahl = '{law = "coulomb", smoothing = {find = [0.002, 0.2]}}'
    found, out = identified((TERMS, TERMS.replace('"coulomb"', dahl)))
    (field,) = found["fields"]
    assert (field["term"], field["field"], field["joint"]) == ("coulomb", "smoothing", None)
    assert field["bounds"] == [0.002, 0.2]
    low, high = field["interval"]
    assert 0.002 <= low <= field["value"] <= high <= 0.2
    terms = {term["law"]: term for term in found["terms"]}
    assert terms["coulomb"]["smoothing"] == field["value"]
    assert "Estimated nonlinear parameters" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_joints_weigh_by_noise_or_alike(identified: Identified, tmp_path: Path) -> None:
    equal = ("[signals]\n", '[estimation]\nweights = "equal"\n\n[signals]\n')
    _, out = identified(equal)
    model = steelyard.load_model(out)
    assert model.estimate.estimator == "physically consistent (entropic prior)"
    assert [e.estimator for e in model.reference] == ["ordinary least squares"]


@pytest.mark.slow
def test_plain_least_squares_can_be_had(identified: Identified) -> None:
    plain, out = identified(
        ("[signals]\n", '[estimation]\nmethod = "least_squares"\n\n[signals]\n')
    )
    model = steelyard.load_model(out)
    assert model.estimate.estimator == "weighted least squares"
    assert model.estimate.standard is None
    assert any("inertias may be invalid" in note for note in plain["notes"])
    assert not any("does not use" in note for note in plain["notes"])


@pytest.mark.slow
def test_knowledge_that_plain_least_squares_passes_over_is_checked_and_reported(
    identified: Identified, given: Path, tmp_path: Path, command: Command
) -> None:
    knowledge = '[[knowledge]]\nkind = "mass"\nlink = "{}"\nupper = 9.0\n\n[signals]\n'
    plain = '[estimation]\nmethod = "least_squares"\n\n[prior]\nuncertainty = 0.2\n\n'
    found, _ = identified(("[signals]\n", plain + knowledge.format("forearm")))
    assert "WLS does not use [prior]" in found["notes"]
    only = "WLS uses of [[knowledge]] only values of whole base parameters, not: "
    (note,) = (note for note in found["notes"] if note.startswith(only))
    assert "the mass of link 'forearm' is at most 9 kg" in note
    robot = edited(given, tmp_path, ("[signals]\n", plain + knowledge.format("forarm")))
    done = command("identify", robot, given / "identification.csv", "-o", tmp_path / "other")
    assert done.exit_code == 2 and "'forarm'" in done.stderr


@pytest.mark.slow
def test_friction_that_drives_is_named(given: Path, tmp_path: Path, command: Command) -> None:
    reversed_efforts = ('unit = "Nm"', 'unit = "Nm"\ngain = -1.0')
    robot = edited(given, tmp_path, reversed_efforts)
    urdf = tmp_path / "demo_arm.urdf"
    urdf.write_text(re.sub(r' effort="[^"]*"', "", urdf.read_text()))
    log = f"{given / 'identification.csv'}@0:5"
    done = command("identify", robot, log, "-o", tmp_path / "no")
    assert done.exit_code == 2 and "all efforts have the opposite sign" in done.stderr
    assert not (tmp_path / "no").exists()
    options = ("--no-check", "--method", "bounded LS", "-o", tmp_path / "out", "--json")
    driven = command("identify", robot, log, *options)
    (note,) = (
        note for note in json.loads(driven.stdout)["notes"] if "below the physical bound" in note
    )
    assert "viscous.elbow" in note and "coulomb.elbow" in note


@pytest.mark.slow
def test_twins_are_refused_where_fields_are_found_too(
    given: Path, tmp_path: Path, command: Command
) -> None:
    twins = '{law = "stribeck", speed = "find"}, {law = "spring", free = "unknown"}'
    robot = edited(given, tmp_path, (TERMS, TERMS.replace('"viscous"', twins)))
    done = command("identify", robot, given / "identification.csv", "--no-check", "-o", "out")
    assert done.exit_code == 2 and "not distinguishable from" in done.stderr, done.output
    assert not Path("out").exists()


@pytest.mark.slow
def test_a_poor_prediction_is_called_poor(given: Path, tmp_path: Path, command: Command) -> None:
    columns = ", ".join(f'"q{k}_rad"' for k in (3, 2, 1))
    velocities = columns.replace("q", "dq").replace("_rad", "_rad_s")
    changes = (
        ('position = "q{}_rad"', f"position = [{columns}]"),
        ('velocity = "dq{}_rad_s"', f"velocity = [{velocities}]"),
    )
    logs = given / "identification.csv", "--validate", given / "validation.csv"
    plain = ("[signals]\n", '[estimation]\nmethod = "least_squares"\n\n[signals]\n')
    robot = edited(given, tmp_path, *changes, plain)
    done = command("identify", robot, *logs, "-o", tmp_path / "out", "--no-check")
    assert done.exit_code == 1 and done.stdout.startswith("POOR: "), done.output
