"""Names of log columns read as words, and the message where columns cannot be assigned."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import LogError
from steelyard.robot.robot import Coordinate, JointKind

Quantity = Literal["time", "position", "velocity", "acceleration", "effort"]

_QUANTITIES: dict[Quantity, frozenset[str]] = {
    "time": frozenset("time t stamp timestamp timestamps clock".split()),
    "position": frozenset("q qm pos position positions angle angles theta".split()),
    "velocity": frozenset("dq dqm qd qdot vel velocity velocities speed speeds".split()),
    "acceleration": frozenset("ddq qdd qddot acc accel acceleration".split()),
    "effort": frozenset(
        "tau taum torque torques trq effort efforts eff moment current currents curr cur i force "
        "forces".split()
    ),
}
_TARGETS = frozenset(
    "des desired d target targets ref reference references cmd command commands commanded set "
    "setpoint setpoints sp goal goals demand demanded planned action actions".split()
)
_AVOIDED = _TARGETS | frozenset(
    "error err ext external tcp temp temperature temperatures voltage".split()
)
_MOTION_UNITS = frozenset("rad rads deg degs m mm s rpm".split())
_UNIT_WORDS = _MOTION_UNITS | frozenset("nm n a ma v".split())
_SPELLED = {
    "rad": "rad rads",
    "deg": "deg degs degree degrees",
    "m": "m meter meters metre metres",
    "ms": "ms msec millis",
    "us": "us usec micros",
    "ns": "ns nsec nanos",
    "s": "s sec seconds",
}
"""How names spell units, if not as they are."""
_UNITS_OF: dict[JointKind, frozenset[str]] = {
    "revolute": frozenset(f"{_SPELLED['rad']} {_SPELLED['deg']} nm".split()),
    "prismatic": frozenset(f"{_SPELLED['m']} mm n".split()),
}
"""Words for units of angles and torques, and of lengths and forces."""
_UNITS = frozenset.union(*_UNITS_OF.values())
_OF_MESSAGES = re.compile(
    r"/.*/(stamp|log_time|(?P<quantity>position|velocity|effort)/(?P<joint>.+))"
)
_OF_DATASETS = re.compile(
    r"observation[./](?P<quantity>state|position|velocity|effort|torque|tau|current)[./](?P<joint>.+)"
)
"""Names in LeRobot's datasets: a state is a position, unless the element's name says otherwise."""
MOTORS = frozenset("motor motors qm dqm taum".split())  # words of columns of the motors' side
TORQUES = frozenset("tau taum torque torques trq".split())
CURRENTS = frozenset("current currents curr cur i".split())
FINGERS = frozenset("finger fingers gripper knuckle fingertip hand".split())


def words_of(name: str) -> tuple[str, ...]:
    """Lower-case words and numbers of a name: `current_arm1_A` is `current arm 1 a`."""
    return tuple(w.lower() for w in re.findall(r"mA\b|[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name))


@dataclass(frozen=True)
class Column:
    """A column's name and its words; `label` is the joint's name where the log states it."""

    name: str
    label: str = ""

    @cached_property
    def words(self) -> tuple[str, ...]:
        """The name's words."""
        return words_of(self.name)

    @cached_property
    def quantity(self) -> Quantity | None:
        """What the column seems to hold; `None` for targets, errors and the unknown."""
        if _AVOIDED & set(self.words):
            return None
        if found := _OF_MESSAGES.fullmatch(self.name):
            named: Quantity = found["quantity"] or "time"  # type: ignore[assignment]
            return named
        if self.of_state:
            return Column(self.name.split("state", 1)[1]).quantity or "position"
        first = len(self.words) - len(words_of(re.split(r"[./]", self.name)[-1]))
        for number, word in enumerate(self.words):
            for quantity, names in _QUANTITIES.items():
                lone = word in ("t", "i")  # too short to mean much inside a name
                if word in names and not (lone and number not in (0, first)):
                    return quantity
        return None

    @property
    def numbers(self) -> tuple[str, ...]:
        """The numbers in the joint's name, without leading zeros."""
        return tuple(w.lstrip("0") or "0" for w in self.joint_words if w.isdigit())

    @property
    def joint_words(self) -> tuple[str, ...]:
        """The words that may name a joint; all but the topic's if the log is of messages."""
        if self.label:
            return words_of(self.label)
        found = _OF_MESSAGES.fullmatch(self.name) or _OF_DATASETS.fullmatch(self.name)
        return words_of(found["joint"]) if found and found["joint"] else self.words

    @property
    def of_motor(self) -> bool:
        """Whether the name says that it is of the motors' side of the gears."""
        return bool(MOTORS & set(self.words))

    @property
    def of_target(self) -> bool:
        """Whether the name says that it is a set-point of the controller."""
        return bool(_TARGETS & set(self.words))

    @property
    def of_state(self) -> bool:
        """Whether it is of the state in a dataset of LeRobot."""
        found = _OF_DATASETS.fullmatch(self.name)
        return found is not None and found["quantity"] == "state"

    @property
    def stem(self) -> tuple[str, ...]:
        """The name's words without those of a position or velocity and their units."""
        passed = _QUANTITIES["position"] | _QUANTITIES["velocity"] | _MOTION_UNITS
        return tuple(word for word in self.words if word not in passed)

    @property
    def unit_words(self) -> tuple[str, ...]:
        """The words of a unit that the name ends in, such as `rad s` of `dq1_rad_s`."""
        count = next((k for k, w in enumerate(reversed(self.words)) if w not in _UNIT_WORDS), 0)
        return self.words[len(self.words) - count :]

    def unit_named(self, units: Iterable[str]) -> str:
        """Which of some units, such as `deg/s`, the name states; empty if none.

        Metres and seconds last: `m` may be a mere letter.
        """
        for unit in sorted(units, key=lambda unit: (unit in ("m", "m/s", "s"), unit)):
            word = unit.partition("/")[0]
            if self.has(*_SPELLED.get(word, word).split()):
                return unit
        return ""

    @property
    def topic(self) -> str:
        """What stands before the last slash."""
        return self.name.rpartition("/")[0]

    def may_stand_for(self, other: "Column") -> bool:
        """Whether names state neither another quantity nor unit, nor that one is a set-point."""
        pairs = ((self.quantity, other.quantity), (self.unit_words, other.unit_words))
        return all(not a or not b or a == b for a, b in pairs) and self.of_target == other.of_target

    def has(self, *words: str) -> bool:
        """Whether any of the words is in the name."""
        return bool(set(words) & set(self.words))


def labelled(
    columns: Iterable[str], texts: Mapping[str, str], joints: Iterable[str] = ()
) -> list[Column]:
    """Columns, labelled by columns of text that are called alike but for one word.

    `field.position0` by the text of `field.name0`, if it contains a joint's name, of those given.
    """

    def stems(name: str) -> list[tuple[tuple[str, ...], ...]]:
        words = words_of(name)
        return [(words[:k], words[k + 1 :]) for k, w in enumerate(words) if not w.isdigit()]

    known = [set(words_of(joint)) for joint in joints]
    labels = {
        stem: text
        for name, text in texts.items()
        if not known or any(words <= set(words_of(text)) for words in known)
        for stem in stems(name)
    }
    found = ((name, (labels[s] for s in stems(name) if s in labels)) for name in columns)
    return [Column(name, next(label, "")) for name, label in found]


def like_finger(joint: str) -> bool:
    """Whether a joint's name says that it belongs to a hand."""
    return bool(FINGERS & set(words_of(joint)))


def by_name(coordinates: Sequence[Coordinate], columns: Iterable[Column]) -> dict[str, Column]:
    """Columns that carry a joint's name, by joint; a name may be shortened if it stays unique."""
    own = _own_words(coordinates)
    pairs = []
    for column in columns:
        scores = {
            joint: len(words & set(column.joint_words)) + bool(column.label)
            for joint, (words, numbers) in own.items()
            if not numbers or numbers == column.numbers
        }
        best = max(scores.values(), default=0)
        for joint, score in scores.items():
            alone = list(scores.values()).count(best) == 1
            if score == best > 0 and (score == len(own[joint][0]) or alone):
                pairs.append((-score, len(column.words), column.name, joint, column))
    found: dict[str, Column] = {}
    taken: set[str] = set()
    for *_, joint, column in sorted(pairs, key=lambda pair: pair[:4]):
        if joint not in found and column.name not in taken:
            found[joint] = column
            taken.add(column.name)
    return found


def _own_words(coordinates: Sequence[Coordinate]) -> dict[str, tuple[set[str], tuple[str, ...]]]:
    """Words and numbers of each joint's name that not all joints share."""
    names = {c.name: Column(c.name) for c in coordinates}
    common = {"joint"}
    if len(names) > 1:
        common |= set.intersection(*(set(column.words) for column in names.values()))
    return {
        name: (
            {w for w in column.words if not w.isdigit() and w not in common},
            tuple(n for n in column.numbers if n not in common),
        )
        for name, column in names.items()
    }


def by_number(
    count: int, columns: Iterable[Column], kinds: Sequence[JointKind] = ()
) -> list[tuple[Column, ...]]:
    """Groups of `count` columns alike but for their last number, 0 or 1 onwards; best first.

    Units differ where kinds of joints do: `q1_rad, q2_rad, q3_m` is a group too.
    """
    columns = list(columns)
    parts = ((*_stem(column), column) for column in columns)
    mixed = by_key((tuple(w for w in stem if w not in _UNITS), (k, c)) for stem, k, c in parts)
    found = list(_numbered_columns(columns).items())
    found += [(stem, dict(group)) for stem, group in mixed.items() if _differ(group, kinds)]
    fitting = [
        (stem, group)
        for stem, group in found
        if sorted(group) in (list(range(count)), list(range(1, count + 1)))
    ]
    fitting.sort(key=lambda item: _rank(item[0]))
    return [tuple(group[k] for k in sorted(group)) for _, group in fitting]


def partly_by_number(count: int, columns: Iterable[Column]) -> tuple[Column | None, ...]:
    """The largest group of columns alike but for their last number, 0 or 1 onwards, with its gaps.

    A column or `None` for each of `count` places, more than half of them columns; else nothing.
    """
    groups = [
        (stem, tuple(group.get(k + first) for k in range(count)))
        for stem, group in _numbered_columns(columns).items()
        for first in [min(1, *group)]
        if max(group) < count + first and 2 * len(group) > count
    ]
    return min(groups, key=lambda g: (g[1].count(None), _rank(g[0])), default=((), ()))[1]


def _numbered_columns(columns: Iterable[Column]) -> dict[tuple[str, ...], dict[int, Column]]:
    """Columns by their names without the last number, and by that number."""
    parts = ((*_stem(column), column) for column in columns)
    alike = by_key((stem, (number, column)) for stem, number, column in parts)
    return {stem: dict(group) for stem, group in alike.items()}


def _stem(column: Column) -> tuple[tuple[str, ...], int]:
    """A name's words with a sign for the last number, and that number; 1 without one."""
    words, last = column.words, [k for k, word in enumerate(column.words) if word.isdigit()][-1:]
    if not last:
        return words, 1
    return (*words[: last[0]], "#", *words[last[0] + 1 :]), int(words[last[0]])


def _differ(group: Sequence[tuple[int, Column]], kinds: Sequence[JointKind]) -> bool:
    """Whether joints of both kinds have units of theirs, and no number comes twice."""
    numbers = {number for number, _ in group}
    if len(set(kinds)) < 2 or not len(numbers) == len(group) == len(kinds):
        return False
    ordered = [column for _, column in sorted(group, key=lambda pair: pair[0])]
    return all(
        not column.has(*_UNITS_OF["prismatic" if kind == "revolute" else "revolute"])
        for column, kind in zip(ordered, kinds, strict=True)
    )


def _rank(stem: tuple[str, ...]) -> tuple[bool, bool, bool, int]:
    """Joint before motor, torque before current, measured before unsaid, short before long."""
    measured = {"actual", "measured", "meas", "sensor"} & set(stem)
    current = CURRENTS & set(stem) and not TORQUES & set(stem)
    return bool(MOTORS & set(stem)), bool(current), not measured, len(stem)


IN_FILE = (
    'set it in a robot file: [signals] time = "...", position = ["...", ...] and '
    "[signals.effort] columns = [...], kind = ..., unit = ... (`steelyard init` writes one)"
)

OF_MOTORS = (
    "the gears between motors and joints are needed: in a robot file (`steelyard init` writes one) "
    'set [signals] coordinates = "motor" and [robot.transmission] ratios = [turns of each motor '
    "per turn of its joint], with coupling = [...] where a motor turns with a second joint; and "
    "[signals.effort] columns = [...], kind = ..., side, unit = ..."
)

UNNAMED = re.compile(r"column_\d+")  # names that columns without a name have
LISTED = 3  # columns of a group that are all named


def give_up(wrong: str, columns: Sequence[str], fix: str = IN_FILE) -> NoReturn:
    """Refuse columns, with all their names."""
    if columns and all(map(UNNAMED.fullmatch, columns)):
        raise LogError(
            "the log's columns have no names: the file seems to have no header line",
            where=f"columns {columns[0]} to {columns[-1]}",
            fix=f"put a line of names before the numbers, such as time,q1,q2; or {fix}",
        )
    raise LogError(
        f"the log's columns cannot be assigned: {wrong}",
        where=f"columns {', '.join(columns)}",
        fix=fix,
    )


def finite(values: ArrayLike) -> Array:
    """The finite values of a column, shape `(N,)`; none of a column of text."""
    array = np.asarray(values)
    if array.dtype.kind == "U":
        return np.zeros(0)
    array = array.astype(np.float64)
    return np.asarray(array[np.isfinite(array)])


def listed(columns: Sequence[Column]) -> str:
    """Names of columns in words; of many, the first and the last."""
    if len(columns) > LISTED:
        return f"{columns[0].name} to {columns[-1].name} ({len(columns)} columns)"
    return ", ".join(c.name for c in columns)
