"""Mistakes in the causes of torque that a robot file lists, and the words that answer them."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from cli.conftest import Command
from cli.river_files import edited

TERMS = 'terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]'
GEARS = "[robot.transmission]\nratios = [1, 1, 1]\n\n[model]"

MISTAKES = {
    '{law = "coulomb", joints = 5}': ("joints = 5", "list names"),
    '{law = "coulomb", joints = []}': ("joints = ()", "leave `joints` out"),
    '{law = "coulomb", joints = ["elbwo"]}': ("'elbwo'", "elbow"),
    '{law = "coulomb", motors = 3}': ("motors = 3", "list names"),
    '{law = "coulomb", motors = ["m"]}': ("motor 'm'", "[robot.transmission]"),
    '{law = "coulomb", along = {}}': ("along ()", "along = {wrist"),
    '{law = "coulomb", along = {w = {elbow = inf}}}': ("inf", "along = {wrist"),
    '{law = "coulomb", along = {w = 3}}': ("('w', 3)", "along = {wrist"),
    '{law = "coulomb", threshold = true}': ("threshold = True", "neither true nor false"),
    '{law = "coulomb", threshold = [0.1]}': ("(0.1,) for 3", "one per coordinate"),
    '{law = "coulomb", per_run = "yes"}': ("per_run = 'yes'", "true or false"),
    '{law = "dahl", length = 0}': ("length = 0", "above zero"),
    '{law = "lugre", speed = [0.0, 0.1]}': ("speed = (0.0, 0.1)", "above zero"),
    '{law = "load_dependent", length = 0.0}': ("length = 0.0", "above zero"),
    '{law = "stribeck", speed = 0.0}': ("speed = 0.0", "above zero"),
    '{law = "maxwell_slip", lengths = 1e-3}': ("lengths 0.001", "one length above zero"),
    '{law = "maxwell_slip", lengths = ["a"]}': ("lengths ('a',)", "one length above zero"),
    '{law = "maxwell_slip", lengths = [inf]}': ("inf", "one length above zero"),
    '{law = "maxwell_slip", lengths = [true]}': ("(True,)", "neither true nor false"),
    '{law = "maxwell_slip", relaxing = "no"}': ("relaxing = 'no'", "true or false"),
    '{law = "spring", free = [0.0]}': ("1 free positions for 3", "one per coordinate"),
    '{law = "coupled", pairs = 5}': ("the pair 5", '{from = "hip", to = "knee"}'),
    '{law = "gravity_compensator", links = 5, points = 5}': ("the links 5", "points = [["),
    '{law = "gravity_compensator", name = 5, links = ["base", "hand"], '
    "points = [[0, 0, 0], [0, 0, 1]]}": ("the name 5", "points = [["),
    '{law = "gravity_compensator", links = ["base", "hadn"], points = [[0, 0, 0], [0, 0, 1]]}': (
        "link 'hadn'",
        "'hand'",
    ),
}

Robot = Callable[..., Path]


@pytest.fixture
def robot(given: Path, tmp_path: Path) -> Robot:
    """The demo arm with other terms, and more replaced."""

    def written(terms: str, *changes: tuple[str, str]) -> Path:
        return edited(given, tmp_path, (TERMS, terms), *changes)

    return written


@pytest.mark.parametrize("term", MISTAKES)
def test_a_term_that_cannot_be_is_shown_in_the_file(
    term: str, robot: Robot, given: Path, command: Command
) -> None:
    path = robot(f'terms = ["rigid_body", {term}]')
    out = path.parent / "out"
    done = command("identify", path, given / "identification.csv", "-o", out)
    message = " ".join(done.stderr.split())
    assert done.exit_code == 2 and not out.exists(), done.output
    assert message.startswith("error:") and "arm.toml, line" in message and "terms[2]" in message, (
        message
    )
    assert all(word in message for word in MISTAKES[term]), message


def test_two_motors_have_two_names(robot: Robot, given: Path, command: Command) -> None:
    gears = GEARS.replace("ratios", 'motors = ["a", "a", "b"]\nratios')
    path = robot(TERMS, ("[model]", gears))
    done = command("identify", path, given / "identification.csv", "-o", path.parent / "out")
    assert done.exit_code == 2 and "two motors are called 'a'" in done.stderr, done.output
    assert "name of its own" in done.stderr and "[robot.transmission] motors" in done.stderr
    gears = GEARS.replace("ratios", 'motors = ["a", "elbow", "b"]\nratios')
    path = robot(TERMS, ("[model]", gears))
    done = command("identify", path, given / "identification.csv", "-o", path.parent / "out")
    assert done.exit_code == 2 and "motor 'elbow' has the name of a joint" in done.stderr


def test_behind_the_gears_no_motor_couples(robot: Robot, given: Path, command: Command) -> None:
    pair = '{law = "coupled", pairs = [{from = "motor_1", to = "elbow"}]}'
    kind = ('kind = "joint_torque"', 'kind = "link_torque"')
    path = robot(f'terms = ["rigid_body", {pair}]', ("[model]", GEARS), kind)
    done = command("identify", path, given / "identification.csv", "-o", path.parent / "out")
    assert done.exit_code == 2 and "the motors' side" in done.stderr, done.output


@pytest.mark.slow
def test_fields_are_not_found_for_friction_that_is_not_chosen_yet(
    robot: Robot, given: Path, command: Command
) -> None:
    wrist = '{law = "stribeck", speed = "find", along = {w = {elbow = 1.0, shoulder_lift = 1.0}}}'
    path = robot(f'terms = ["rigid_body", {wrist}]\nfriction = "auto"')
    done = command("identify", path, given / "identification.csv", "-o", path.parent / "out")
    assert done.exit_code == 2 and "while friction is selected" in done.stderr, done.output
    assert "'stribeck'" in done.stderr and '"auto"' in done.stderr


@pytest.mark.slow
def test_a_virtual_robot_whose_friction_is_open_has_some(robot: Robot, command: Command) -> None:
    path = robot('terms = ["rigid_body", "rotor_inertia"]\nfriction = "auto"')
    out = path.parent / "run"
    done = command("simulate", path, "--period", 1, "-o", out)
    assert done.exit_code == 0, done.output
    names = json.loads((out / "truth.json").read_text())["parameters"]
    assert names["coulomb.elbow"]["value"] > 0.0 and names["viscous.elbow"]["value"] > 0.0


@pytest.mark.slow
def test_a_payload_needs_bodies_to_add_to(robot: Robot, given: Path, command: Command) -> None:
    path, log = robot('terms = ["viscous", "offset"]'), given / "identification.csv"
    out = path.parent / "out"
    done = command("identify", path, f"{log}@:3", "--no-check", "-o", out)
    assert done.exit_code == 1 and "POOR" in done.output  # and written all the same
    done = command("payload", out, f"{log}@3:")
    assert done.exit_code == 2 and "terms have none" in done.stderr, done.output
    assert '"rigid_body"' in done.stderr


@pytest.mark.parametrize("part", ["frames", "loops"])
def test_a_saved_model_has_nothing_on_bodies_that_it_lacks(
    part: str, identified: Path, tmp_path: Path, given: Path, command: Command
) -> None:
    data = json.loads((identified / "model.json").read_text())
    strange = {
        "frames": {
            "name": "x",
            "body": 9,
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            "position": [0, 0, 0],
        },
        "loops": {"name": "x", "bodies": [0, 9], "points": [[0, 0, 0], [0, 0, 0]]},
    }
    data["model"]["robot"][part] = [strange[part]]
    (tmp_path / "model.json").write_text(json.dumps(data))
    done = command("validate", tmp_path, given / "validation.csv")
    assert done.exit_code == 2 and "a body that does not exist" in done.stderr, done.output
