"""Names of robots, joints and frames as identifiers of C and Python, and as text of comments."""

import re
import unicodedata
from collections.abc import Sequence

_SIGNS = str.maketrans({"²": "^2", "³": "^3", "√": "sqrt "})
"""Signs of units."""


def identifier(text: str, otherwise: str) -> str:
    """Letters, digits and single underscores of a name, with a letter first; never empty.

    Args:
        text: The name.
        otherwise: What stands before a name that begins with a digit, and for one without letters.
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_").lower()
    return name if name[:1].isalpha() else f"{otherwise}_{name}".strip("_")


def identifiers(names: Sequence[str], otherwise: str) -> tuple[str, ...]:
    """One identifier per name, no two alike: later ones get a number."""
    found: list[str] = []
    for name in names:
        plain = candidate = identifier(name, otherwise)
        count = 1
        while candidate in found:
            count += 1
            candidate = f"{plain}_{count}"
        found.append(candidate)
    return tuple(found)


def commented(text: str) -> str:
    """Text that ends no comment of C and no docstring, in ASCII and on one line."""
    plain = text.translate(_SIGNS).encode("ascii", "backslashreplace").decode()
    for risky, safe in (("\\", "/"), ("*/", "* /"), ("/*", "/ *"), ("??", "? ?"), ('"', "'")):
        plain = plain.replace(risky, safe)
    return " ".join(plain.split())
