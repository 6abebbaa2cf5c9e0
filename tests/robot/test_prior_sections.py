"""The sections of a robot file that state prior constraints."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.file.toml_edits import edited
from steelyard.robot.init.draft_robot_file import assigned, drafted, proposed

URDF = """<robot name="one"><link name="a"/><link name="b"/>
<joint name="elbow" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "one.urdf").write_text(URDF)
    return tmp_path


def read(folder: Path, text: str) -> LoadedRobot:
    return load_robot(folder / "arm.toml", f'[robot]\nurdf = "one.urdf"\n{text}')


def test_sections_are_carried_as_written(folder: Path) -> None:
    loaded = read(
        folder,
        """
[estimation]
method = "least_squares"
[prior]
source = "none"
uncertainty = 0.3
links.b = {mass = 2, box = {size = [0.1, 0.1, 0.2]}}
[[knowledge]]
kind = "mass"
link = "b"
lower = 1
[[knowledge]]
kind = "total_mass"
upper = 3.5
""",
    )
    assert loaded.estimation.method == "least_squares"
    assert loaded.prior.source == "none" and loaded.prior.uncertainty == 0.3
    given = loaded.prior.links["b"]
    assert (
        given.source == "model"
        and given.mass == 2.0
        and given.com is None
        and given.capsule is None
    )
    assert given.box is not None and given.box.size == (0.1, 0.1, 0.2)
    assert given.box.centre == (0.0, 0.0, 0.0)
    assert loaded.knowledge == (
        {"kind": "mass", "link": "b", "lower": 1},
        {"kind": "total_mass", "upper": 3.5},
    )
    assert loaded.where("knowledge", 1).endswith("arm.toml, line 14, [knowledge[2]]")


def test_without_them_the_model_is_the_prior(folder: Path) -> None:
    for loaded in (read(folder, ""), load_robot(folder / "one.urdf")):
        assert loaded.estimation.method == "consistent"
        assert loaded.prior.source == "model" and loaded.prior.links == {}
        assert loaded.prior.uncertainty is None and loaded.knowledge == ()


@pytest.mark.parametrize(
    ("text", "wrong", "line", "fix"),
    [
        ("[prior]\nsorce = 1", "unknown key 'sorce'", 4, "did you mean 'source'"),
        ('[prior]\nsource = "cad"', "'cad' cannot be used", 4, "'model' or 'none'"),
        ("[prior]\nuncertainty = 0", "0 cannot be used", 4, "greater than or equal to 0.0001"),
        ("[prior.links.b]\nmas = 1", "unknown key 'mas'", 4, "did you mean 'mass'"),
        (
            "[prior.links.b]\nmass = -1",
            "-1 cannot be used for 'mass'",
            4,
            "greater than 0",
        ),
        ('[prior.links]\nb = "none"', "'none' cannot be used for 'b'", 4, "should be a table"),
        ("[prior.links.b]\nbox = {centre = [0, 0, 0]}", "key 'size' is missing", 4, "add size"),
        (
            "[prior.links.b]\nbox = {size = [1, 1, 0]}",
            "0 cannot be used",
            4,
            "greater than 0",
        ),
        (
            "[prior.links.b]\ncapsule = {end = [0, 0, 1], radius = 0.1, length = 1}",
            "unknown key 'length'",
            4,
            "",
        ),
        ("[knowledge]\nlower = 1", "cannot be used for 'knowledge'", 3, "list in [ ]"),
    ],
)
def test_mistakes_name_line_and_key(
    folder: Path, text: str, wrong: str, line: int, fix: str
) -> None:
    with pytest.raises(ModelError) as caught:
        read(folder, text)
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert f"arm.toml, line {line}, " in caught.value.where


def test_a_new_robot_file_shows_how_to_write_them(folder: Path) -> None:
    model, output = folder / "one.urdf", folder / "arm.toml"
    proposal = proposed(model)
    text = drafted(proposal, assigned(proposal, None, None), output).text
    begin, end = text.index("[prior]"), text.index("[validation]")
    lines = [x.removeprefix("# ") for x in text[begin:end].replace("NAME", "b").splitlines()]
    shown = [x for x in lines if x.startswith("[") or " = " in x]
    loaded = load_robot(output, text[:begin] + "\n".join(shown) + "\n" + text[end:])
    assert loaded.prior.source == "model" and set(loaded.prior.links) == {"b"}
    assert loaded.prior.uncertainty is None and "left out, it is estimated from the data" in text
    assert [table["kind"] for table in loaded.knowledge] == ["total_mass"]


def test_edits_leave_them_as_they_are(folder: Path) -> None:
    text = """[robot]
urdf = "one.urdf"
[prior.links.b]
mass = 2.0                        # on a scale
[[knowledge]]                     # the data sheet
kind = "total_mass"
upper = 3.5
[[knowledge]]
kind = "mass"
link = "b"
lower = 1.0
"""
    before = load_robot(folder / "arm.toml", text)
    for path in (("estimation", "weights"), ("prior", "source"), ("robot", "name")):
        change = SimpleNamespace(path=path, value="model" if path[0] == "prior" else "equal")
        changed = edited(text, [change])
        loaded = load_robot(folder / "arm.toml", changed)
        assert loaded.knowledge == before.knowledge
        assert loaded.prior.links == before.prior.links
        assert "# on a scale" in changed and "# the data sheet" in changed
