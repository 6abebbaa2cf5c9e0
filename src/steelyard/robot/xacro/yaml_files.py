"""YAML files that xacro files read their numbers from."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from steelyard.errors import ModelError
from steelyard.robot.xacro.values import XacroError
from steelyard.robot.xml_reader import read_bytes

UNITS = {
    "!radians": 1.0,
    "!degrees": math.pi / 180.0,
    "!meters": 1.0,
    "!millimeters": 0.001,
    "!foot": 0.3048,
    "!inches": 0.0254,
}
TRUTHS = {
    word: truth
    for truth, words in (("true", "yes on"), ("false", "no off"))
    for one in words.split()
    for word in (one, one.capitalize(), one.upper())
}
"""Truth values of YAML 1.1, which xacro reads; `y` and `n` are names there, as of coordinates."""
LARGEST = 20_000
"""Values in a file, with those that are repeated by reference."""


def load_yaml(path: Path, number: Callable[[str], Any]) -> Any:
    """Tables, lists and scalars of a YAML file; nothing else is constructed.

    Args:
        path: The file.
        number: Evaluates the expression of a value with a unit, `!degrees 90`.

    Raises:
        XacroError: It is missing, no YAML, too large, or asks for other objects.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    fix = "give the YAML file that the xacro file came with"
    if path.suffix.lower() not in (".yaml", ".yml") or not os.path.isfile(path):
        raise XacroError(f"there is no YAML file '{path}'", fix)
    yaml = YAML(typ="safe", pure=True)
    try:
        content = read_bytes(path, "a YAML file")
        if len(content) > 1_000_000:
            raise XacroError(f"'{path}' is larger than 1 MB", fix)
        node = yaml.compose(content.decode("utf-8-sig"))
        if node is None:
            return {}
        _prepare(node, number, {}, ())
        return yaml.constructor.construct_document(node)
    except ModelError as error:
        raise XacroError(f"'{path}': {error.wrong}", fix) from None
    except (YAMLError, ValueError, TypeError, RecursionError) as error:
        words = " ".join(str(error).split())[:200]
        raise XacroError(f"'{path}' is not plain YAML: {words}", fix) from None


def _prepare(
    node: Any, number: Callable[[str], Any], sizes: dict[int, int], above: tuple[int, ...]
) -> int:
    """Turn values with units into numbers, words into truths; how many values there are."""
    if id(node) in above:
        raise ValueError("a value contains itself")
    if id(node) in sizes:
        return sizes[id(node)]
    if node.tag == "tag:yaml.org,2002:str" and node.style is None and node.value in TRUTHS:
        node.tag, node.value = "tag:yaml.org,2002:bool", TRUTHS[node.value]
    if node.tag in UNITS:
        value = float(number(str(node.value))) * UNITS[node.tag]
        node.tag = "tag:yaml.org,2002:float"
        node.value = repr(value)
    parts = node.value if isinstance(node.value, list) else []
    inside = [part for entry in parts for part in (entry if isinstance(entry, tuple) else (entry,))]
    size = 1 + sum(_prepare(part, number, sizes, (*above, id(node))) for part in inside)
    if size > LARGEST:
        raise ValueError(f"there are more than {LARGEST} values")
    sizes[id(node)] = size
    return size
