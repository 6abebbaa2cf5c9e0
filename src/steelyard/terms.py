"""Causes of torque that are linear in their parameters: one class per law, by its name.

`dir(steelyard.terms)` lists them; `steelyard.terms.Coulomb(smoothing=0.01)` makes one.
"""

from typing import Any


def __getattr__(name: str) -> Any:
    """The law of a class's name."""
    classes = _classes() if name[:1].isupper() else {}
    if name not in classes:
        raise AttributeError(f"module 'steelyard.terms' has no attribute '{name}'")
    return classes[name]


def __dir__() -> list[str]:
    return sorted(_classes())


def _classes() -> dict[str, Any]:
    from steelyard.model.laws.register import TERMS

    return {term.__name__: term for term in TERMS.values()}
