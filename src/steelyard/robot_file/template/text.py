"""Values, keys and comments in the TOML that `steelyard init` writes."""

import json
import re
import textwrap
from typing import Any


def toml_text(value: Any) -> str:
    """A value in TOML."""
    if isinstance(value, tuple | list):
        return "[" + ", ".join(toml_text(v) for v in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value))


def comment(text: str, start: str = "# ") -> str:
    """The text as comment lines, whatever characters are in it."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    again = start[: len(start) - len(start.lstrip())] + "#   "
    return textwrap.fill(printable, 98, initial_indent=start, subsequent_indent=again)


def toml_key(name: str) -> str:
    """A key in TOML, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_text(name)
