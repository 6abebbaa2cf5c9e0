"""Text of strangers, such as names in logs and models, made fit to be printed."""

import unicodedata

UNPRINTABLE = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that move the cursor, turn the direction of writing or cannot be encoded."""


def visible(text: str, keep: str = "") -> str:
    r"""The text with control characters, those in `keep` apart, written as Python escapes them.

    A terminal would obey them: an escape sequence or a line feed in a column's name can print a
    line that looks like the program's own.

    Example:
        >>> print(visible("q1\x1b[1A"))
        q1\x1b[1A
    """
    if text.isprintable():
        return text
    return "".join(
        letter.encode("unicode_escape").decode("ascii")
        if letter not in keep and unicodedata.category(letter) in UNPRINTABLE
        else letter
        for letter in text
    )
