"""The numbers in a message, by their paths: `wrench/force/x`, or `position/elbow_joint`."""

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import lru_cache
from itertools import islice
from math import nan
from typing import Any

import numpy as np

from steelyard.formats.messages.messages import seconds

LONGEST_ARRAY = 256
"""Numbers of the longest array that becomes columns; images and maps have more."""
MOST_FIELDS = 4096
"""Numbers of a message that become columns."""
DEEPEST = 16
JOINT_QUANTITIES = ("position", "velocity", "effort")
_TIMES = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))
_SCALARS = (bool, int, float, np.bool_, np.integer, np.floating)


def fields_of(message: Any) -> tuple[str, ...]:
    """Paths of the numbers in a message; its header and its stamp are left out."""
    names = _joints(message)
    if names is None:
        return tuple(path for path, _ in islice(_flat(message, "", 0), MOST_FIELDS))
    found = []
    for quantity in JOINT_QUANTITIES:
        values = _child(message, quantity)
        count = 0 if values is None else len(values)
        labels = names or [str(i) for i in range(count)]
        found += [f"{quantity}/{name}" for name in dict.fromkeys(labels[:count])]
    return tuple(found[:MOST_FIELDS])


def is_of_joints(message: Any) -> bool:
    """Whether a message says names of joints and their positions, velocities or efforts."""
    return _joints(message) is not None


def stamp_of(message: Any) -> float | None:
    """When a message says that it was measured [s]; `None` if it does not."""
    for node in (_child(message, "header"), message):
        for name in ("stamp", "timestamp"):
            if node is not None and (time := _seconds(_child(node, name))) is not None:
                return time
    return None


class Picker:
    """Takes the same fields out of every message.

    Args:
        wanted: Their paths.
    """

    def __init__(self, wanted: Sequence[str]) -> None:
        self._count = len(wanted)
        self._joints = [field.partition("/")[::2] for field in wanted]
        self._names: Any = None
        self._places: list[tuple[str, list[tuple[int, int]]]] = []
        self._groups: dict[tuple[str, ...], list[tuple[int, str]]] = {}
        for k, field in enumerate(wanted):
            *parents, leaf = field.split("/")
            self._groups.setdefault(tuple(parents), []).append((k, leaf))

    def pick(self, message: Any) -> list[float] | None:
        """The fields' values, NaN for those that are not there.

        `None` for a message that is of other joints, as when an arm and its gripper publish on one
        topic.
        """
        names = _joints(message)
        if names is not None:
            return self._of_joints(message, names)
        values = [nan] * self._count
        for parents, leaves in self._groups.items():
            node = message
            for part in parents:
                node = _child(node, part)
            if node is not None:
                for k, leaf in leaves:
                    values[k] = _number(_child(node, leaf))
        return values

    def _of_joints(self, message: Any, names: list[str]) -> list[float] | None:
        if names != self._names:
            self._names = list(names)
            self._places = self._places_of(names)
        if not self._places:
            return None
        values = [nan] * self._count
        for quantity, places in self._places:
            array = _child(message, quantity)
            logged = array.tolist() if isinstance(array, np.ndarray) else array or ()
            for k, i in places:
                if i < len(logged):
                    values[k] = _number(logged[i])
        return values

    def _places_of(self, names: list[str]) -> list[tuple[str, list[tuple[int, int]]]]:
        """Per quantity, where the fields are in this order of joints."""
        at = {name: i for i, name in reversed(list(enumerate(names)))}
        places: dict[str, list[tuple[int, int]]] = {}
        for k, (quantity, name) in enumerate(self._joints):
            i = at.get(name) if names else int(name) if name.isdecimal() else None
            if i is not None and quantity in JOINT_QUANTITIES:
                places.setdefault(quantity, []).append((k, i))
        return list(places.items())


def _joints(message: Any) -> list[str] | None:
    """Names of the joints a message is about, in its order; `None` if it is no joint state."""
    names = _child(message, "name")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return None
    arrays = [_child(message, quantity) for quantity in JOINT_QUANTITIES]
    given = [array for array in arrays if array is not None]
    if not given or not all(isinstance(array, (list, np.ndarray)) for array in given):
        return None
    return names


def _flat(node: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Paths and values of the numbers in a message."""
    for name, child in _children(node):
        if depth == 0 and (name == "header" or (name == "stamp" and _seconds(child) is not None)):
            continue
        if isinstance(child, _SCALARS) or _is_time(child):
            yield path + name, child
        elif isinstance(child, (list, tuple, np.ndarray)):
            inner = list(islice(_flat(child, f"{path}{name}/", depth + 1), LONGEST_ARRAY + 1))
            if len(inner) <= LONGEST_ARRAY:
                yield from inner
        elif depth < DEEPEST:
            yield from _flat(child, f"{path}{name}/", depth + 1)


def _children(node: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(node, dict):
        yield from ((name, child) for name, child in node.items() if name and "/" not in name)
    elif is_dataclass(node):
        kind: Any = type(node)
        yield from ((name, getattr(node, name)) for name in _names(kind))
    elif isinstance(node, (list, tuple, np.ndarray)) and len(node) <= LONGEST_ARRAY:
        yield from ((str(i), child) for i, child in enumerate(node))


@lru_cache(maxsize=1024)
def _names(kind: Any) -> tuple[str, ...]:
    """Names of a message's fields; those with a default are the type's constants."""
    return tuple(field.name for field in fields(kind) if field.default is MISSING)


def _child(node: Any, name: str) -> Any:
    if isinstance(node, dict):
        return node.get(name)
    if isinstance(node, (list, tuple, np.ndarray)):
        return node[int(name)] if name.isdecimal() and int(name) < len(node) else None
    return getattr(node, name, None)


def _number(value: Any) -> float:
    """A number as float, a time in seconds; NaN for what is neither."""
    if isinstance(value, float):
        return value
    if isinstance(value, _SCALARS):
        try:
            return float(value)
        except OverflowError:
            return nan
    time = _seconds(value)
    return nan if time is None else time


def _is_time(value: Any) -> bool:
    return _seconds(value) is not None


def _seconds(value: Any) -> float | None:
    """A time of whole seconds and nanoseconds as one number [s]."""
    if value is None or isinstance(value, (*_SCALARS, str, list, np.ndarray)):
        return None
    for whole, part in _TIMES:
        sec, nsec = _child(value, whole), _child(value, part)
        if isinstance(sec, int) and isinstance(nsec, int):
            if abs(sec) < 1 << 63 and abs(nsec) < 1 << 63:
                return seconds(sec * 1_000_000_000 + nsec)
    return None
