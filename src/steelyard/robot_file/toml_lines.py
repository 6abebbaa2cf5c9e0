"""Where each key of a TOML text is: the line numbers that `tomllib` does not give."""

import re
from dataclasses import dataclass

KeyPath = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' r"|'''.*?'{3,5}" r'|"(?:\\.|[^"\\\n])*"' r"|'[^'\n]*'", re.S
)
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\n]+")


@dataclass(frozen=True)
class Written:
    """A key of a table, or a table's header.

    Attributes:
        header: Whether it is a header; `path` is then the table's.
        table: The table under whose header it stands.
        path: The key from the root.
        end: Offset in the text behind its value, or behind the header.
    """

    header: bool
    table: KeyPath
    path: KeyPath
    end: int


class _Scanner:
    """One walk over a text that `tomllib` has already accepted."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[KeyPath, int] = {}
        self.counts: dict[KeyPath, int] = {}
        self.written: list[Written] = []

    def run(self) -> "_Scanner":
        table: KeyPath = ()
        self.skip(_BLANK)
        while self.at < len(self.text):
            header = self.text[self.at] == "["
            if header:
                table = self.header()
            path = table if header else self.pair(table)
            self.written.append(Written(header, table, path, self.at))
            self.skip(_BLANK)
        return self

    def skip(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        found = match.group() if match else ""
        self.at += len(found)
        return found

    def note(self, path: KeyPath) -> None:
        """The path and every table above it are on this line, unless seen before."""
        line = self.text.count("\n", 0, self.at) + 1
        for end in range(1, len(path) + 1):
            self.lines.setdefault(path[:end], line)

    def header(self) -> KeyPath:
        several = self.text.startswith("[[", self.at)
        self.at += 2 if several else 1
        start = self.at
        *above, last = self.key()
        end, self.at = self.at, start
        path: KeyPath = ()
        for part in above:
            path = (*path, part)
            if path in self.counts:
                path = (*path, self.counts[path] - 1)
        path = (*path, last)
        if several:
            self.counts[path] = self.counts.get(path, 0) + 1
            path = (*path, self.counts[path] - 1)
        self.note(path)
        self.at = end + (2 if several else 1)
        return path

    def key(self) -> list[str]:
        parts = []
        while True:
            self.skip(_SPACE)
            quoted = self.skip(_STRING)
            parts.append(quoted[1:-1] if quoted else self.skip(_BARE))
            self.skip(_SPACE)
            if not self.text.startswith(".", self.at):
                return parts
            self.at += 1

    def pair(self, table: KeyPath) -> KeyPath:
        start = self.at
        path = (*table, *self.key())
        end, self.at = self.at, start
        self.note(path)
        self.at = end + 1  # the equals sign
        self.skip(_SPACE)
        self.value(path)
        return path

    def value(self, path: KeyPath) -> None:
        opening = self.text[self.at]
        if opening in "\"'":
            self.skip(_STRING)
        elif opening == "[":
            self.items(path, "]")
        elif opening == "{":
            self.items(path, "}")
        else:
            self.skip(_SCALAR)

    def items(self, path: KeyPath, closing: str) -> None:
        self.at += 1
        index = 0
        self.skip(_BLANK)
        while self.text[self.at] != closing:
            if closing == "}":
                self.pair(path)
            else:
                self.note((*path, index))
                self.value((*path, index))
            index += 1
            self.skip(_BLANK)
            if self.text[self.at] == ",":
                self.at += 1
                self.skip(_BLANK)
        self.at += 1


def toml_lines(text: str) -> dict[KeyPath, int]:
    """The line, from 1, of every table, key and array item of a valid TOML text.

    Paths are keys and indices from the root: `("robot", "dh", "links", 0, "alpha")`.
    """
    return _Scanner(text).run().lines


def toml_written(text: str) -> list[Written]:
    """Headers and keys of a valid TOML text in their order, without those in inline tables."""
    return _Scanner(text).run().written
