from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import edited, lines_of
from steelyard.robot.file.toml_schema import tomllib


@dataclass(frozen=True)
class Edit:
    path: tuple[str, ...]
    value: Any


TEXT = """\
# the whole file
[robot]
name = "a"  # a name
# which way is down
gravity = [0.0, 0.0, -9.81]

# where the fingers are
[robot.locked]
finger = 0.0

[signals]
position = "q{}"  # of the joints

# efforts
[signals.effort]
unit = "A"  # not mA
gain = [
  1.0,  # first
  2.0,
]

# scores
[validation]
cutoff = 5.0
"""


def test_values_change_and_all_else_stays() -> None:
    unit = edited(TEXT, [Edit(("signals", "effort", "unit"), "mA")])
    assert unit == TEXT.replace('"A"', '"mA"')
    gain = edited(TEXT, [Edit(("signals", "effort", "gain"), np.array([3.0, 4.0]))])
    assert gain == TEXT.replace("[\n  1.0,  # first\n  2.0,\n]", "[3.0, 4.0]")
    away = edited(TEXT, [Edit(("robot", "name"), None), Edit(("robot", "base"), None)])
    assert away == TEXT.replace('name = "a"  # a name\n', "")


@pytest.mark.parametrize(
    ("path", "value", "line", "after"),
    [
        ("signals.position_sign", (1, -1), "position_sign = [1, -1]", '"q{}"  # of the joints\n'),
        ("signals.effort.delay", 0.01, "delay = 0.01", "  2.0,\n]\n"),
        ("robot.base", "b", 'base = "b"', "[0.0, 0.0, -9.81]\n"),
        ("robot.mounting", {"roll": 90.0, "yaw": 1.0}, "mounting = {roll = 90.0, yaw = 1.0}",
         "[0.0, 0.0, -9.81]\n"),
        ("robot.mounting.roll", np.float64(90.0), "mounting = {roll = 90.0}",
         "[0.0, 0.0, -9.81]\n"),
        ("robot.limits.elbow.upper", 1, "limits = {elbow = {upper = 1}}", "[0.0, 0.0, -9.81]\n"),
        ("robot.locked.left thumb", 0.5, '"left thumb" = 0.5', "finger = 0.0\n"),
    ],
)  # fmt: skip
def test_new_keys_follow_the_last_of_their_table(
    path: str, value: object, line: str, after: str
) -> None:
    new = edited(TEXT, [Edit(tuple(path.split(".")), value)])
    assert new == TEXT.replace(after, f"{after}{line}\n")


def test_new_tables_come_last() -> None:
    speed, cutoff = Edit(("processing", "rest_speed"), 0.1), Edit(("processing", "cut"), 2.0)
    assert edited(TEXT, [speed, cutoff]) == f"{TEXT}\n[processing]\nrest_speed = 0.1\ncut = 2.0\n"
    assert edited("", [speed]) == "[processing]\nrest_speed = 0.1\n"
    assert edited("[a.b]\nc = 1\n", [Edit(("a", "d"), 2)]) == "[a.b]\nc = 1\n\n[a]\nd = 2\n"
    assert edited("[a]\n[a.b]\nc = 1", [Edit(("a", "d"), 2)]) == "[a]\nd = 2\n[a.b]\nc = 1"
    assert edited("[a]\nb = 1", [Edit(("c",), 2)]) == "c = 2\n[a]\nb = 1"


def test_a_new_table_below_others_has_its_own_head_and_lists_of_tables_stay_in_line() -> None:
    walls = [{"normal": [0.0, 0.0, 1.0], "above": 0.2}]
    keys = {"floor": 0.1, "planes": walls}
    text = edited(TEXT, [Edit(("excitation", "workspace", k), v) for k, v in keys.items()])
    wall = "{normal = [0.0, 0.0, 1.0], above = 0.2}"
    lines = ["", "[excitation.workspace]", "floor = 0.1", f"planes = [{wall}]", ""]
    assert text == TEXT + "\n".join(lines)
    assert tomllib.loads(text)["excitation"]["workspace"] == keys


def test_inline_and_dotted_tables() -> None:
    text = "[robot]\nmounting = {roll = 1.0}\nlocked.a = 2.0\n"
    yaw, b = Edit(("robot", "mounting", "yaw"), 3.0), Edit(("robot", "locked", "b"), 4.0)
    assert edited(text, [yaw, b]) == (
        "[robot]\nmounting = {roll = 1.0, yaw = 3.0}\nlocked.a = 2.0\nlocked.b = 4.0\n"
    )
    assert edited(text, [Edit(("robot", "mounting", "roll"), None)]) == text.replace(
        "{roll = 1.0}", "{}"
    )


def test_lines_to_paste() -> None:
    edits = [
        Edit(("signals", "effort", "unit"), "mA"),
        Edit(("robot", "gravity"), None),
        Edit(("signals", "effort", "gain"), (1.0, 2.0)),
    ]
    assert lines_of(edits) == (
        '[signals.effort]\nunit = "mA"\ngain = [1.0, 2.0]\n\n[robot]\n# remove gravity'
    )


@pytest.mark.parametrize(
    ("text", "path", "words"),
    [("a = 1", ("a", "b"), "'[a]' is no table"), ("a = = 1", ("b",), "the text is not TOML")],
)
def test_what_cannot_be_edited(text: str, path: tuple[str, ...], words: str) -> None:
    with pytest.raises(ModelError) as caught:
        edited(text, [Edit(path, 1)])
    assert words in str(caught.value) and "change it by hand" in str(caught.value)


NAMES = st.sampled_from(["a", "b", "robot", "signals", "locked", "x y", "effort", ""])
VALUES = st.one_of(
    st.none(),
    st.integers(-5, 5),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=8),
    st.lists(st.floats(-9, 9), max_size=3),
    st.lists(st.sampled_from([1, -1]), max_size=3),
)
EDITS = st.lists(
    st.builds(Edit, st.lists(NAMES, min_size=2, max_size=4).map(tuple), VALUES), max_size=5
)


def meant(data: dict[str, Any], edit: Edit) -> None:
    """The edit done to plain values."""
    *above, last = edit.path
    for name in above:
        if edit.value is None and name not in data:
            return
        data = data.setdefault(name, {})
    if edit.value is None:
        data.pop(last, None)
    else:
        data[last] = edit.value


@pytest.mark.slow
@given(edits=EDITS)
def test_edits_mean_what_they_say(edits: list[Edit]) -> None:
    text, data = TEXT, tomllib.loads(TEXT)
    for edit in edits:
        try:
            text = edited(text, [edit])
        except ModelError as error:
            assert "is no table" in str(error)
        else:
            meant(data, edit)
    assert tomllib.loads(text) == data
    if any(edit.path in (("signals", "effort"), ("robot", "locked")) for edit in edits):
        return  # a table goes with its comments
    kept = [line for line in TEXT.splitlines() if line.startswith("#")]
    assert [line for line in text.splitlines() if line in kept] == kept


URDF = """<robot name="r"><link name="a"/><link name="b"/>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="3" effort="40"/></joint></robot>"""


def test_a_robot_is_loaded_from_changed_text(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(URDF)
    path, text = tmp_path / "robot.toml", '[robot]\nurdf = "r.urdf"\n'
    new = edited(text, [Edit(("robot", "gravity"), (9.81, 0.0, 0.0))])
    loaded = load_robot(path, new)
    assert loaded.robot.gravity.tolist() == [9.81, 0.0, 0.0] and not path.exists()
    path.write_text(new)
    assert [s.sha256 for s in load_robot(path).sources] == [s.sha256 for s in loaded.sources]
    with pytest.raises(ModelError, match="line 3"):
        load_robot(path, f"{text}tip = 3\n")
