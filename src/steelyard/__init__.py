"""steelyard: identify a robot's dynamics from its motion and its torque.

A robot file and logs in, a model with its uncertainty out:

    import steelyard

    found = steelyard.identify("ur10e.toml", ["run1.csv", "run2.csv"], validate="run3.csv")
    print(found)
    found.save("ur10e-model")
    torque = found.model.torque(steelyard.Motion(t, q, dq, ddq))

`dir(steelyard)` lists all names; each has an example in its docstring.
"""

import re
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from steelyard.base.errors import SteelyardError as SteelyardError

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_HOMES = {
    name: home
    for home, name in re.findall(r"^from (steelyard\.\S+) import \(?\s*(\w+)", _STUB, re.M)
}
"""The module of each public name, as the stub says it to type checkers."""

__all__ = [*_HOMES, "terms"]


class _Package(ModuleType):
    """This package. Some functions have the name of their room, such as `identify`.

    Importing a room would set its name to the module; here it remains the function.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    """Load what is heavier only on first use: the command line starts at once."""
    if name == "__version__":
        return import_module("importlib.metadata").version("steelyard")
    if name == "terms":
        return import_module("steelyard.terms")
    if name not in _HOMES:
        raise AttributeError(f"module 'steelyard' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
