"""Xacro files: what they expand to, and that a stranger's file cannot do more than that."""

import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import pytest

from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.models.xacro import (
    expand,
    is_xacro,
    joined_reference,
    split_reference,
    stem_of,
)
from steelyard.robot.models.xacro_expressions import Budget

Write = Callable[[str, str], Path]
HEAD = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="r">'
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
ARM = f"""{HEAD[:-3]}$(arg name)">
<xacro:arg name="name" default="arm"/>
<xacro:arg name="two" default="true"/>
<xacro:property name="density" value="${{2 * 3.5}}"/>
<xacro:macro name="arm_link" params="name mass:=${{density}} *inertia">
  <link name="${{name}}"><inertial><mass value="${{mass}}"/>
    <xacro:insert_block name="inertia"/></inertial></link>
</xacro:macro>
<link name="base"/>
<xacro:arm_link name="upper">{INERTIA}</xacro:arm_link>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/>
  <limit lower="${{-pi}}" upper="${{radians(90)}}" effort="9" velocity="2"/></joint>
<xacro:if value="$(arg two)">
  <xacro:arm_link name="lower" mass="2">{INERTIA}</xacro:arm_link>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="lower"/></joint>
</xacro:if>
</robot>"""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STEELYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(name: str, text: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return written


def expanded(path: Path, **arguments: str) -> ElementTree.Element:
    made = expand(path, arguments)
    assert made is not None
    return ElementTree.parse(made.path).getroot()


def value(write: Write, expression: str, more: str = "") -> str:
    """What an attribute with the text becomes."""
    text = expression.replace("<", "&lt;").replace('"', "&quot;")
    path = write("one.xacro", f'{HEAD}{more}<link name="a" x="{text}"/></robot>')
    return expanded(path).find("link").attrib["x"]  # type: ignore[union-attr]


def test_arm(write: Write) -> None:
    path = write("arm.urdf.xacro", ARM)
    robot = load_robot(path)
    assert (robot.robot.name, robot.robot.joint_names) == ("arm", ("j1", "j2"))
    assert [body.inertia.mass for body in robot.robot.bodies] == [7.0, 2.0]
    assert robot.robot.coordinates[0].limits.upper == pytest.approx(1.5707963)
    assert robot.stem == "arm"
    assert [s.path.name for s in robot.sources] == ["arm.urdf.xacro", "arm.urdf"]
    assert robot.notes[0] == "arm.urdf.xacro is expanded with no arguments"


def test_arguments_behind_the_file(write: Write) -> None:
    path = write("arm.urdf.xacro", ARM)
    robot = load_robot(f"{path} name:=left two:=false")
    assert (robot.robot.name, robot.robot.joint_names) == ("left", ("j1",))
    assert robot.notes[0] == "arm.urdf.xacro is expanded with name:=left two:=false"
    again = load_robot(robot.reference)
    assert again.robot.joint_names == ("j1",)
    assert again.sources == robot.sources
    assert robot.sources[-1].sha256 != load_robot(path).sources[-1].sha256


def test_reference() -> None:
    assert split_reference("a b.xacro x:=1 y:=a b:c") == (
        Path("a b.xacro"),
        {"x": "1", "y": "a b:c"},
    )
    assert joined_reference(Path("a.xacro"), {"x": "1", "y": ""}) == "a.xacro x:=1 y:="
    assert split_reference("a.xacro x:=1 y:=")[1] == {"x": "1", "y": ""}
    assert [stem_of(n) for n in ("a.urdf.xacro x:=1.5", "b.v2.urdf", "c.xacro")] == [
        "a",
        "b.v2",
        "c",
    ]


def test_robot_file(write: Write) -> None:
    write("model/arm.urdf.xacro", ARM)
    file = write(
        "arm.toml",
        '[robot]\nurdf = "model/arm.urdf.xacro"\nxacro.arguments = {name = "left", two = false}\n',
    )
    robot = load_robot(file)
    assert (robot.robot.name, robot.robot.joint_names) == ("left", ("j1",))
    assert robot.model_given.name == "arm.urdf.xacro"
    with pytest.raises(ModelError, match="arguments stand behind a robot file"):
        load_robot(f"{file} two:=true")


def test_a_plain_urdf_has_no_arguments(write: Write) -> None:
    path = write("a.urdf", '<robot name="r"><link name="a"/></robot>')
    assert expand(path, {}) is None
    with pytest.raises(ModelError, match="not a xacro file"):
        expand(path, {"x": "1"})


def test_a_substitution_alone_makes_a_urdf_xacro(write: Write) -> None:
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
    links = f'<link name="a"/><link name="b"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
    origin = '<origin xyz="$(optenv STEELYARD_UNSET 0.5 0 0)"/>'
    path = write("husky.urdf", f'<robot name="r">{links}{joint}{origin}</joint></robot>')
    body = load_robot(path).robot.bodies[0]
    assert body.position.tolist() == [0.5, 0.0, 0.0]


def test_xacro_is_distinguished_by_what_is_read(write: Write) -> None:
    path = write("arm.urdf", ARM)
    assert is_xacro(path)
    assert load_robot(path).robot.joint_names == ("j1", "j2")


def test_tags_left_over_in_visuals_are_passed_over(write: Write) -> None:
    body = f'<inertial><mass value="1"/>{INERTIA}</inertial>'
    left = '<visual><xacro:color name="${x}"/></visual><collision><x y="$(find z)"/></collision>'
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>'
    path = write(
        "a.urdf", f'{HEAD}<link name="a"/><link name="b">{body}{left}</link>{joint}</robot>'
    )
    assert load_robot(path).robot.joint_names == ("j",)


VALUES = {
    "${1 + 2 * 3}": "7",
    "${2 ** 3 / 4}": "2.0",
    "${7 // 2} ${7 % 4}": "3 3",
    "a${1}b": "a1b",
    "$${a} $$(b)": "${a} $(b)",
    "${'x' if 1 < 2 <= 2 and not false else 'y'}": "x",
    "${sin(0) + math.cos(0)}": "1.0",
    "${[1, 2, 3][-1] + len('abc')}": "6",
    "${dict(a=1)['a']} ${dict(a=2).get('b', 5)}": "1 5",
    "${'%.2f %s' % (pi, 'x')}": "3.14 x",
    "${' '.join(['a', 'b'])}": "a b",
    "${'AbC'.lower().replace('b', '--')}": "a--c",
    "${max(1, 2)} ${min([3, 4])} ${round(2.567, 1)} ${abs(-1) if false else 1}": "2 3 2.6 1",
    "${[x * 2 for x in range(4) if x > 1]}": "[4, 6]",
    "${int('12') + float('0.5')}": "12.5",
    "${'a' in ['a', 'b']} ${None is None}": "True True",
    "${xacro.tokenize('a, b;c')}": "['a', 'b', 'c']",
    "${xacro.tokenize('a b', '')}": "['a b']",
    "$(eval radians(0) + 1)": "1.0",
    "$(optenv HOME none)": "none",
    "${'12'}": "12",
}


@pytest.mark.parametrize("text", VALUES)
def test_values(write: Write, text: str) -> None:
    assert value(write, text) == VALUES[text]


def test_properties(write: Write) -> None:
    lazy = '<xacro:property name="a" value="${b + 1}"/><xacro:property name="b" value="2"/>'
    assert value(write, "${a}", lazy) == "3"
    kept = '<xacro:property name="a" value="1"/><xacro:property name="a" default="2"/>'
    assert value(write, "${a}", kept) == "1"
    circle = '<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/>'
    with pytest.raises(ModelError, match="defined by each other: a -> b -> a"):
        value(write, "${a}", circle)


def test_yaml_includes_and_packages(write: Write) -> None:
    write("ws/arm_description/package.xml", "<package><name>arm_description</name></package>")
    write(
        "ws/arm_description/config/limits.yaml",
        "all: &a {low: -1.5, high: !degrees 180}\nj: {<<: *a, names: [x, y], flag: off}\n",
    )
    write(
        "ws/arm_description/urdf/part.xacro",
        f'{HEAD}<xacro:property name="n" value="5"/><xacro:macro name="m" params="p">'
        '<link name="${p}"/></xacro:macro></robot>',
    )
    path = write(
        "ws/arm_description/robots/arm.urdf.xacro",
        f'{HEAD}<xacro:include filename="$(find arm_description)/urdf/part.xacro" ns="part"/>'
        '<xacro:include filename="../urdf/pa*.xacro"/>'
        '<xacro:include filename="none.xacro" optional="true"/>'
        '<xacro:property name="c" value="${xacro.load_yaml(\'../config/limits.yaml\')}"/>'
        '<xacro:part.m p="a"/><xacro:call macro="m" p="b${part.n}"/>'
        '<joint low="${c[\'j\'][\'low\']}" high="${c.j.high}" name="${c.j.names[1]}${c.j.flag}"/>'
        "</robot>",
    )
    root = expanded(path)
    assert [link.attrib["name"] for link in root.iter("link")] == ["a", "b5"]
    joint = root.find("joint")
    assert joint is not None
    assert joint.attrib == {"low": "-1.5", "high": "3.141592653589793", "name": "yFalse"}


@pytest.mark.parametrize("way", ["robot file", "ros1", "ros2", "above"])
def test_where_packages_are(write: Write, monkeypatch: pytest.MonkeyPatch, way: str) -> None:
    model = "arm.xacro" if way != "above" else "elsewhere/share/other/urdf/arm.xacro"
    inside = f'{HEAD}<link name="a"/><link name="b"/></robot>'
    write("elsewhere/share/hands/urdf/hand.xacro", inside.replace("<link", '<link y="1"'))
    path = write(model, f'{HEAD}<xacro:include filename="$(find hands)/urdf/hand.xacro"/></robot>')
    folder = path.parent / "elsewhere"
    packages: list[Path] = []
    if way == "robot file":
        packages = [folder / "share"]
    elif way == "ros1":
        monkeypatch.setenv("ROS_PACKAGE_PATH", f"/none:{folder / 'share'}")
    elif way == "ros2":
        monkeypatch.setenv("AMENT_PREFIX_PATH", str(folder))
    assert expand(path, {}, packages) is not None


def test_a_missing_package(write: Write) -> None:
    absent = "$(find hands)/urdf/hand.xacro"
    path = write("arm.xacro", f'{HEAD}\n<xacro:include filename="{absent}"/></robot>')
    with pytest.raises(ModelError) as caught:
        expand(path, {}, [path.parent / "src"])
    assert "the package 'hands' is not found" in caught.value.wrong
    assert str(path.parent / "src") in caught.value.wrong
    assert caught.value.where == f"{path}, line 2"
    assert "ROS_PACKAGE_PATH=" in caught.value.fix and "[robot.xacro] packages" in caught.value.fix


def test_a_package_of_meshes_may_be_missing(write: Write) -> None:
    mesh = '<link name="a"><visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    write("here/meshes/a.stl", "")
    for name, made in [
        ("$(find nowhere)/a.stl", "package://nowhere/a.stl"),
        ("package://here/meshes/a.stl", (write("x", "").parent / "here/meshes/a.stl").as_posix()),
    ]:
        path = write("here/arm.xacro", f"{HEAD}{mesh.format(name)}</robot>")
        assert next(expanded(path).iter("mesh")).attrib["filename"] == made


ERRORS = {
    "missing argument": (
        '<link name="$(arg side)"/>',
        "the argument 'side' is not given",
        "side:=VALUE",
    ),
    "unknown name": ('<link name="${side}"/>', "'side' is not defined", "define"),
    "unknown macro": ("<xacro:hand/>", "there is no macro 'hand'", "define or include"),
    "parameter": (
        '<xacro:macro name="m" params="a"/><xacro:m/>',
        "not given its parameter 'a'",
        "write a=",
    ),
    "no parameter": ('<xacro:macro name="m"/><xacro:m b="1"/>', "no parameter 'b'", "none"),
    "blocks": ('<xacro:macro name="m" params="*a"/><xacro:m/>', "takes 1 blocks, and", "elements"),
    "condition": ('<xacro:if value="maybe"/>', "neither true nor false", "true"),
    "file": ('<xacro:include filename="a.xacro"/>', "a.xacro' to be included does not", "folders"),
    "command": ('<link name="$(anon x)"/>', "$(anon x) is not supported", "$(arg NAME)"),
    "cwd": ('<link name="$(cwd)"/>', "$(cwd) is not supported", "$(dirname)"),
    "environment": ('<link name="$(env HOME)"/>', "argument 'HOME' is not given", "HOME:=VALUE"),
    "fatal": (
        "<a b=\"${xacro.fatal('no', 'arm')}\"/>",
        "the file raised an error: no arm",
        "arguments",
    ),
    "syntax": ('<a b="${1 +}"/>', "'1 +' is not an expression", "correct"),
    "zero": ('<a b="${1 / 0}"/>', "expression '1 / 0': division by zero", "correct"),
    "entry": ('<a b="${dict(a=1).b}"/>', "there is no entry 'b'", "correct"),
    "yaml": ("<a b=\"${load_yaml('c.yaml')}\"/>", "there is no YAML file", "YAML file"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_errors(write: Write, name: str) -> None:
    text, wrong, fix = ERRORS[name]
    path = write("arm.xacro", f"{HEAD}\n{text}</robot>")
    with pytest.raises(ModelError) as caught:
        expand(path, {})
    assert wrong in caught.value.wrong
    assert caught.value.where == f"{path}, line 2"
    assert fix in caught.value.fix


def test_places_of_calls(write: Write) -> None:
    path = write(
        "a.xacro",
        f'{HEAD}\n<xacro:macro name="m">\n<b c="${{d}}"/></xacro:macro>\n<xacro:m/></robot>',
    )
    with pytest.raises(ModelError) as caught:
        expand(path, {})
    assert caught.value.where == f"{path}, line 3, called in {path}, line 4"


def test_an_argument_that_the_file_does_not_have(write: Write) -> None:
    with pytest.raises(ModelError) as caught:
        expand(write("arm.urdf.xacro", ARM), {"nam": "x"})
    assert caught.value.fix == "did you mean 'name'?"


def test_a_file_of_macros(write: Write) -> None:
    path = write("r/urdf/hand.xacro", f'{HEAD}<xacro:macro name="hand"/></robot>')
    write(
        "r/urdf/arm.urdf.xacro",
        f'{HEAD}<xacro:include filename="$(find r)/urdf/hand.xacro"/></robot>',
    )
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert caught.value.wrong == "the file only defines macros (hand), and no robot"
    assert caught.value.fix.endswith("here arm.urdf.xacro")


HOSTILE = {
    "import": "__import__('os').system('touch hacked')",
    "classes": "().__class__.__mro__[1].__subclasses__()",
    "in a lambda": "(lambda: ().__class__)()",
    "in a comprehension": "[c for c in [1] if c.__class__]",
    "getattr": "getattr(1, 'real')",
    "type": "type(1)",
    "vars": "python.vars(math)",
    "open": "open('/etc/passwd')",
    "function's inside": "sin.__self__",
    "method's inside": "'a'.join.__self__",
    "format": "'{0.__class__}'.format(1)",
    "f-string": "f'{1:>99999999}'",
    "assignment": "(x := 1)",
    "power": "9**9**9",
    "power of a power": "(10**999)**999",
    "shift": "1 << 10**9",
    "product": "(2**4000) * (2**4000)",
    "text": "'a' * 10**10",
    "list": "[0] * 10**9",
    "times": "10**9 * 'a'",
    "range": "range(10**12)",
    "sum": "sum(range(10**8))",
    "width": "'%999999999d' % 1",
    "width behind a space": "'% 999999999d' % 1",
    "width behind two signs": "'%l%%999999999d' % (1, 1)",
    "star": "'%*d' % (10**9, 1)",
    "replaced": "('a' * 9999).replace('a', 'b' * 9999)",
    "joined": "('a' * 9999).join(['b'] * 9999)",
    "written into a text": "('%(a)s' * 20000) % dict(a='x' * 90000)",
    "round": "round(10, -10**9)",
    "factorial": "factorial(10**9)",
    "digits": "int('9' * 9999)",
    "nested": "-" * 3000 + "1",
    "long": "1 + " * 2000 + "1",
    "loops": "[[y for y in range(9999)] for x in range(9999)]",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HOSTILE)
def test_expressions_that_are_refused(write: Write, name: str) -> None:
    start = time.process_time()
    with pytest.raises(ModelError, match="expression"):
        value(write, "${" + HOSTILE[name] + "}")
    assert time.process_time() - start < 20.0
    assert not Path("hacked").exists()


def test_commands_are_no_way_around(write: Write) -> None:
    for text in ("$(eval ().__class__)", "$(eval __import__('os'))"):
        with pytest.raises(ModelError, match="expression"):
            value(write, text)


def test_parameters_with_an_open_quote(write: Write) -> None:
    params = "a:=" + "x" * 5000 + "'"
    path = write("a.xacro", f'{HEAD}<xacro:macro name="m" params="{params}"/><xacro:m/></robot>')
    with pytest.raises(ModelError, match="not given its parameter"):
        expand(path, {})


@pytest.mark.parametrize("part", ["$", "${", "$("])
def test_texts_of_many_marks(write: Write, part: str) -> None:
    path = write("a.xacro", f'{HEAD}<link name="{part * 100_000}"/></robot>')
    with pytest.raises(ModelError, match="grows without end"):
        expand(path, {})


@pytest.mark.parametrize("name", ["a" * 300 + ".xacro", "a/" * 5000 + "b.xacro"])
def test_names_of_files_that_are_too_long(write: Write, name: str) -> None:
    path = write("a.xacro", f'{HEAD}<xacro:include filename="{name}"/></robot>')
    with pytest.raises(ModelError, match="to be included does not exist"):
        expand(path, {})


def test_patterns_do_not_search_all_folders(write: Write) -> None:
    write("deep/part.xacro", f'{HEAD}<link name="a"/></robot>')
    path = write("a.xacro", f'{HEAD}<xacro:include filename="**"/></robot>')
    with pytest.raises(ModelError, match="nested more than 100 times"):
        expand(path, {})


def macro(name: str, body: str) -> str:
    return f'<xacro:macro name="{name}">{body}</xacro:macro>'


def test_a_macro_that_calls_itself(write: Write) -> None:
    path = write("a.xacro", HEAD + macro("m", "<xacro:m/>") + "<xacro:m/></robot>")
    with pytest.raises(ModelError, match="nested more than 100 times"):
        expand(path, {})


def test_a_file_that_includes_itself(write: Write) -> None:
    path = write("a.xacro", f'{HEAD}<xacro:include filename="a.xacro"/></robot>')
    with pytest.raises(ModelError, match="nested more than 100 times"):
        expand(path, {})


@pytest.mark.slow
def test_macros_that_double(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests here spend the whole of the work that an expansion may take."""
    monkeypatch.setattr(Budget.__init__, "__defaults__", (200_000,))
    doubled = "".join(macro(f"m{k}", f"<xacro:m{k + 1}/>" * 2) for k in range(60))
    path = write(
        "a.xacro", HEAD + doubled + macro("m60", "<link name='a'/>") + "<xacro:m0/></robot>"
    )
    with pytest.raises(ModelError, match="grows without end"):
        expand(path, {})


@pytest.mark.parametrize("value", ["${p%d}${p%d}", "${[p%d, p%d]}"])
def test_properties_that_double(write: Write, value: str) -> None:
    lines = '<xacro:property name="p0" value="aaaa"/>'
    for k in range(60):
        lines += f'<xacro:property name="p{k + 1}" value="{value % (k, k)}"/>'
    path = write("a.xacro", f'{HEAD}{lines}<link name="${{p60}}"/></robot>')
    with pytest.raises(ModelError, match="longer than 100000 characters"):
        expand(path, {})


def test_entities(write: Write) -> None:
    bomb = '<!DOCTYPE r [<!ENTITY a "aaa"><!ENTITY b "&a;&a;">]>'
    path = write("part.xacro", f"{bomb}{HEAD}<link name='&b;'/></robot>")
    for file in (path, write("a.xacro", f'{HEAD}<xacro:include filename="part.xacro"/></robot>')):
        with pytest.raises(ModelError, match="entities"):
            expand(file, {})


YAML = {
    "aliases": "a0: &a0 [1, 1]\n"
    + "".join(f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 9)}]\n" for k in range(9)),
    "merges": "a0: &a0 {x: 1, y: 2}\n"
    + "".join(f"a{k + 1}: &a{k + 1} {{<<: [{', '.join([f'*a{k}'] * 9)}]}}\n" for k in range(9)),
    "circle": "a: &a [*a]",
    "object": "a: !!python/object/apply:os.system ['touch hacked']",
    "expression": "a: !degrees ().__class__",
}


@pytest.mark.parametrize("name", YAML)
def test_yaml_that_is_refused(write: Write, name: str) -> None:
    write("c.yaml", YAML[name])
    with pytest.raises(ModelError):
        value(write, "${load_yaml('c.yaml')}")
    assert not Path("hacked").exists()


def test_only_yaml_files_are_read_as_yaml(write: Write) -> None:
    write("secret.txt", "key: 1")
    with pytest.raises(ModelError, match="no YAML file"):
        value(write, "${load_yaml('secret.txt')}")


ORACLE = f"""{HEAD}
<xacro:property name="a" value="2"/>
<xacro:property name="name_1" value="1_000"/>
<xacro:property name="quoted" value="'3'"/>
<xacro:property name="block"><one x="${{a}}"/><two/></xacro:property>
<xacro:macro name="inner" params="p q:=^|7 r:=${{a * 2}} s:=' x y '">
  <inner p="${{p}}" q="${{q}}" r="${{r}}" s="${{s}}" t="${{outer_only}}"/>
  <xacro:property name="out" value="${{p + 1}}" scope="parent"/>
  <xacro:property name="all" value="${{p + 2}}" scope="global"/>
</xacro:macro>
<xacro:macro name="outer" params="q **content *one">
  <xacro:property name="outer_only" value="o"/>
  <xacro:inner p="1"/><after out="${{out}}"/>
  <xacro:insert_block name="content"/><xacro:insert_block name="one"/>
  <xacro:insert_block name="block"/>
</xacro:macro>
<xacro:outer q="9"><x><u v="${{a}}"/><w/></x><y z="$${{a}}"/></xacro:outer>
<link name="a" all="${{all}}" n="${{name_1}}" q="${{quoted}}" text="${{a + 0.0}}"/>
<xacro:unless value="${{a == 3}}"><not/></xacro:unless>
<xacro:element xacro:name="made${{a}}" b="1"><xacro:attribute name="c" value="c${{a}}"/>
</xacro:element>
<xacro:property name="a" remove="true"/>
<text>value ${{name_1}}</text>
</robot>"""


@pytest.mark.slow
@pytest.mark.skipif(find_spec("xacro") is None, reason="the package xacro is not installed")
@pytest.mark.parametrize("text", [ARM.replace("$(arg name)", "arm", 1), ORACLE])
def test_against_the_program_xacro(write: Write, text: str) -> None:
    path = write("a.urdf.xacro", text)
    script = "import sys, xacro; print(xacro.process_file(sys.argv[1], mappings={}).toxml())"
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    )

    def parts(root: ElementTree.Element) -> list[object]:
        return [(e.tag, e.attrib, (e.text or "").strip()) for e in root.iter()]

    assert parts(expanded(path)) == parts(ElementTree.fromstring(done.stdout))
