"""`steelyard export`: what it writes, prints and refuses."""

import json
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import leftovers
from steelyard.check.fitted.implausible_estimates_and_gear_side import light_links
from steelyard.export.model_files.export_model_file import LIGHT_LINKS
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from weighed import identified_of


@pytest.fixture(scope="module")
def model(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model of the demo arm that has all standard parameters."""
    folder = tmp_path_factory.mktemp("model")
    robot = load_robot(given / "demo_arm.toml").robot
    (folder / "model.json").write_text(identified_of(robot).text(), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("options", "name"), [(["--to", "mjcf"], "arm.xml"), ([], "arm.xml"), ([], "arm.urdf")]
)
def test_a_file_is_written(
    options: list[str], name: str, model: Path, command: Command, tmp_path: Path
) -> None:
    done = command("export", model, *options, "-o", tmp_path / name)
    assert done.exit_code == 0, done.output
    assert [path.name for path in tmp_path.iterdir()] == [name]
    words = " ".join(done.stdout.split())
    form = "MJCF" if name == "arm.xml" else "URDF"
    assert f"{name}: " in words and "moving links" in words and " kg" in words
    assert f"{form} cannot represent:" in words and "constant efforts (offset)" in words
    assert ("rotor inertia" in words) == (form == "URDF")
    assert mujoco.MjModel.from_xml_path(str(tmp_path / name)).nu == (0 if form == "URDF" else 3)


def test_json_and_the_usual_name(
    model: Path, command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("export", model / "model.json", "--to", "urdf", "--json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed["format"] == "urdf" and printed["file"].endswith(".urdf")
    assert any("(offset)" in sentence for sentence in printed["unsupported"])
    assert Path(printed["file"]).is_absolute() and printed["not_seen"] == []
    assert (
        set(printed["mass_from_data"].values()) == {1.0} and printed["impossible_in_original"] == []
    )
    assert load_robot(printed["file"]).robot.n == 3
    again = command("export", model / "model.json", "--to", "urdf")
    assert again.exit_code == 2 and "exists already" in again.output
    Path(printed["file"]).unlink()
    done = command("export", model, "--to", "urdf")
    assert done.stdout.startswith(f"{printed['file']}: ")
    assert "prior" not in done.stdout and "Not identifiable" not in done.stdout
    Path(printed["file"]).unlink()


def test_what_is_not_from_the_data_is_reported(
    given: Path, command: Command, tmp_path: Path
) -> None:
    robot = load_robot(given / "demo_arm.toml").robot
    identified = identified_of(robot)
    standard = identified.estimate.standard
    assert standard is not None
    shares = standard.learned.copy()
    mass, friction = f"m.{robot.bodies[1].name}", f"viscous.{robot.joints[2].name}"
    shares[standard.parameters.names.index(mass)] = 0.2
    shares[standard.parameters.names.index(friction)] = 0.0
    estimate = replace(identified.estimate, standard=replace(standard, learned=shares))
    text = replace(identified, estimate=estimate).text()
    (tmp_path / "model.json").write_text(text, encoding="utf-8")
    urdf = load_robot(given / "demo_arm.toml").sources[-1].path.read_text(encoding="utf-8")
    before, base, after = urdf.partition('<link name="base">')
    broken = before + base + re.sub(r'ixx="[^"]*"', 'ixx="-1"', after, count=1)
    assert broken != urdf
    (tmp_path / "broken.urdf").write_text(broken, encoding="utf-8")
    done = command(
        "export", tmp_path, "--model", tmp_path / "broken.urdf", "-o", tmp_path / "a.urdf"
    )
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert f"comes from the data): - {robot.bodies[1].name} 20%" in words
    assert f"Not identifiable from the data: - {friction}" in words
    assert "not physically consistent in the original file: - base: a principal moment" in words


def test_numbers_go_into_the_original(
    model: Path, given: Path, command: Command, tmp_path: Path
) -> None:
    done = command("export", model, "--model", given / "demo_arm.toml", "-o", tmp_path / "a.urdf")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "a.urdf").read_text(encoding="utf-8")
    original = load_robot(given / "demo_arm.toml").sources[-1].path.read_text(encoding="utf-8")
    assert text.count("<visual") == original.count("<visual")
    assert text != original and "identified with steelyard 9.9.9" in text


def test_code_for_controllers(
    model: Path, command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("export", model, "--to", "c", "--function", "mass", "--function", "torque")
    assert done.exit_code == 0, done.output
    name = "steelyard_demo_arm"
    words = " ".join(done.stdout.split())
    assert f"{name}-c: {name}.h, {name}.c, {name}_test.c, CMakeLists.txt, README.md" in words
    assert "functions: mass, torque, pose, jacobian local variables: at most" in words
    assert "double tau[3]);" in (tmp_path / f"{name}-c" / f"{name}.h").read_text()
    done = command("export", model, "-o", tmp_path / "arm.py", "--json", "--frame", "forearm")
    printed = json.loads(done.stdout)
    assert printed["format"] == "python" and printed["files"] == ["arm.py"]
    assert printed["functions"][-2:] == ["pose", "jacobian"] and printed["absent"] == []
    compile((tmp_path / "arm.py").read_text(), "arm.py", "exec")
    done = command("export", model, "-o", tmp_path / "arm.fmu")
    assert done.exit_code == 0 and "functions: torque" in done.output
    assert f"sources/{name}_fmi2.c" in " ".join(done.output.split())
    done = command("export", model, "--to", "ros2")
    assert done.exit_code == 0, done.output
    assert "functions: torque, gravity, bias, friction, mass" in " ".join(done.output.split())
    assert (tmp_path / f"{name}-ros2" / "src" / "solver.cpp").is_file()
    done = command("export", model, "--to", "simulink", "-o", tmp_path / "block")
    assert done.exit_code == 0 and "functions: torque" in done.output
    assert (tmp_path / "block" / f"{name}_sfun.c").is_file()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["-o", "there.urdf"], "the file exists already"),
        ([], "no format is named"),
        (["-o", "arm.txt"], "no format is named"),
        (["--to", "mjcf", "-o", "arm.urdf"], "would be MJCF, but its name ends in '.urdf'"),
        (["--to", "mjcf", "--model", "demo_arm.toml", "-o", "a.xml"], "not into MJCF"),
        (["--to", "urdf", "--model", "nowhere.urdf", "-o", "a.urdf"], "no such file"),
        (["--to", "urdf", "-o", "nowhere/a.urdf"], "cannot be written"),
        (["--to", "c", "-o", "a.py"], "would be C, but its name ends in '.py'"),
        (["--to", "c", "--model", "demo_arm.toml"], "--model does not apply to C"),
        (["-o", "a.py", "--precision", "float"], "precision cannot be chosen for Python"),
        (["-o", "a.urdf", "--frame", "tool"], "--frame does not apply to URDF"),
        (["-o", "a.xml", "--function", "mass"], "--function does not apply to MJCF"),
        (["-o", "a.fmu", "--precision", "float"], "precision cannot be chosen for an FMU"),
        (["-o", "a.fmu", "--frame", "tool"], "frames cannot be chosen for an FMU"),
        (["--to", "ros2", "-o", "a.py"], "would be a ROS 2 package, but its name ends in '.py'"),
        (["--to", "ros2", "--function", "mass"], "cannot be chosen for a ROS 2 package"),
        (["--to", "simulink", "--precision", "float"], "cannot be chosen for Simulink"),
        (["--to", "simulink", "--model", "a.urdf"], "--model does not apply to Simulink"),
        (["--to", "c", "--function", "masses"], "there is no function 'masses'"),
        (["--to", "c", "--frame", "claw"], "there is no frame 'claw'"),
    ],
)
def test_mistakes_are_explained(
    options: list[str], words: str, model: Path, command: Command, given: Path
) -> None:
    options = [str(given / x) if x == "demo_arm.toml" else x for x in options]
    there = Path("there.urdf")
    there.write_text("kept")
    done = command("export", model, *options)
    assert there.read_text() == "kept"
    there.unlink()
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
    assert "fix" in done.output
    assert leftovers(Path()) == []


def test_base_parameters_alone_are_refused(given: Path, command: Command, tmp_path: Path) -> None:
    identified = identified_of(load_robot(given / "demo_arm.toml").robot)
    poor = replace(identified, estimate=replace(identified.estimate, standard=None))
    (tmp_path / "model.json").write_text(poor.text(), encoding="utf-8")
    done = command("export", tmp_path, "-o", tmp_path / "arm.urdf")
    assert done.exit_code == 2
    assert "base parameters only" in done.output and "default estimator" in done.output
    assert "remove method from [estimation]" in done.output
    assert not (tmp_path / "arm.urdf").exists()


def test_implausibly_light_links_are_named(model: Path, command: Command, tmp_path: Path) -> None:
    usual = steelyard.load_model(model)
    assert light_links(usual) == ()
    standard = usual.estimate.standard
    assert standard is not None
    names, values = list(standard.parameters.names), standard.parameters.values.copy()
    body = usual.robot.bodies[2].name
    ten = [names.index(f"{number}.{body}") for number in INERTIAL_NAMES]
    values[ten] *= 0.01 / values[ten[0]]
    light = replace(standard, parameters=replace(standard.parameters, values=values))
    changed = replace(usual, estimate=replace(usual.estimate, standard=light))
    (said,) = light_links(changed)
    assert said.startswith(f"'{body}' 0.01 ± ") and "kg in the model file" in said
    folder = changed.save(tmp_path / "light")
    done = command("export", folder, "--to", "urdf", "-o", tmp_path / "light.urdf")
    assert done.exit_code == 0, done.output
    assert LIGHT_LINKS in " ".join(done.stdout.split()) and body in done.stdout
    assert LIGHT_LINKS in " ".join((tmp_path / "light.urdf").read_text().split())
