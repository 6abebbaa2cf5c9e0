from hypothesis import given
from hypothesis import strategies as st

from steelyard.robot.file.toml_schema import KeyPath, TomlPlaces, tomllib

TEXT = '''# a comment with [brackets] and "quotes"
[robot] # another
name = "x # ] } = y"
joints = [
  "a", # one
  'b\\',
]
"quoted key".sub = 1
locked = {a = 1.0, "b c" = [2, {d = 3}]}

[[robot.dh.links]]
a = 1
[[robot.dh.links]]
alpha = """
[not.a.table]
line\\""""
d = 1979-05-27 07:32:00
[robot.dh.links.sub]
z = \'\'\'
k = 1\'\'\'
[model]
terms = ["x",
  {law = "c", y = 3}]
'''

LINES: dict[KeyPath, int] = {
    ("robot",): 2,
    ("robot", "name"): 3,
    ("robot", "joints"): 4,
    ("robot", "joints", 0): 5,
    ("robot", "joints", 1): 6,
    ("robot", "quoted key", "sub"): 8,
    ("robot", "locked", "a"): 9,
    ("robot", "locked", "b c", 1, "d"): 9,
    ("robot", "dh", "links", 0): 11,
    ("robot", "dh", "links", 0, "a"): 12,
    ("robot", "dh", "links", 1): 13,
    ("robot", "dh", "links", 1, "alpha"): 14,
    ("robot", "dh", "links", 1, "d"): 17,
    ("robot", "dh", "links", 1, "sub", "z"): 19,
    ("model", "terms"): 22,
    ("model", "terms", 1): 23,
    ("model", "terms", 1, "y"): 23,
}


def paths(value: object, above: KeyPath = ()) -> set[KeyPath]:
    """Every path of a parsed TOML value."""
    items = value.items() if isinstance(value, dict) else enumerate(value)  # type: ignore
    found = set()
    for key, inner in items:
        found.add((*above, key))
        if isinstance(inner, dict | list):
            found |= paths(inner, (*above, key))
    return found


def test_lines_of_all_kinds_of_keys() -> None:
    lines = TomlPlaces(TEXT).lines
    assert {path: lines[path] for path in LINES} == LINES
    assert set(lines) == paths(tomllib.loads(TEXT))


@given(st.lists(st.sampled_from(["", "# c = 1", "[[a.b]]", "[[a.b.c]]", "[a.b.d]"]), max_size=9))
def test_paths_are_those_that_tomllib_finds(parts: list[str]) -> None:
    text = "\n".join(f"{part}\nk{k} = [{k}, {{x = 1}}]" for k, part in enumerate(parts))
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    lines = TomlPlaces(text).lines
    assert set(lines) == paths(data)
    for path, line in lines.items():
        if str(path[-1]).startswith("k"):
            assert text.splitlines()[line - 1].startswith(str(path[-1]))
