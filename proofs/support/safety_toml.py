"""Tables as a robot file holds them."""

import json
from typing import Any


def tables_text(tables: dict[str, Any]) -> str:
    """The `[excitation]` tables as text."""
    top = [f"{key} = {toml(value)}" for key, value in tables.items() if key == "samples"]
    lists = [f"{key} = {toml(value)}" for key, value in tables.items() if isinstance(value, list)]
    inner = [
        "\n".join([f"[excitation.{key}]", *(f"{k} = {toml(x)}" for k, x in value.items())])
        for key, value in tables.items()
        if isinstance(value, dict)
    ]
    return "\n".join(["[excitation]", *top, *lists, *inner])


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(x)}" for key, x in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml(x) for x in value) + "]"
    return json.dumps(value)
