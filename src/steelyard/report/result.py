"""What the results of all jobs have in common: a page, a text, files, and a view in notebooks."""

import io
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.console import Console
from rich.text import Text

from steelyard.base.errors import require
from steelyard.base.files import whole_folder
from steelyard.report.terminal import terminal

if TYPE_CHECKING:
    from polars import DataFrame as DataFrame
    from polars import Series as Series
else:
    DataFrame = Series = Any  # polars may be missing, and takes its time

TEXT_WIDTH = 120  # columns of the text that `print` shows


class Result(ABC):
    """A result: `print` it, `save` it, or look at it in a notebook."""

    page_name: ClassVar[str] = "report.html"
    json_name: ClassVar[str] = ""
    """File that `write` puts the numbers into; none if empty."""

    @abstractmethod
    def report(self) -> str:
        """The report as one self-contained HTML page."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as the command's `--json` prints them."""

    def write(self, folder: Path) -> None:
        """Write the result's files into a folder that is there: page, and numbers where named."""
        (folder / self.page_name).write_text(self.report(), encoding="utf-8")
        if self.json_name:
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
            (folder / self.json_name).write_text(f"{text}\n", encoding="utf-8")

    @abstractmethod
    def show(self, console: Console) -> None:
        """Print the result for people."""

    def save(self, folder: str | Path) -> Path:
        """Make a folder with the page and the numbers, whole or not at all.

        Args:
            folder: Where; it must not exist yet, or be empty.
        """
        with whole_folder(Path(folder)) as part:
            self.write(part)
        return Path(folder)

    def __repr__(self) -> str:
        return f"{type(self).__name__}(print it, or write its files with save(FOLDER))"

    def __str__(self) -> str:
        text = io.StringIO()
        self.show(terminal(file=text, width=TEXT_WIDTH))
        return text.getvalue()

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


def print_verdict(console: Console, headline: str, claim: str, warnings: Iterable[str]) -> None:
    """Print what was found, what that rests on, and what qualifies it."""
    console.print(Text(headline, style="bold"))
    console.print(Text(claim))
    for warning in warnings:
        console.print(Text(f"! {warning}", style="yellow"))


def frame(records: Sequence[Mapping[str, Any]] | Mapping[str, Any], where: str) -> DataFrame:
    """A data frame of rows that have the same keys, or of columns by name.

    Raises:
        PackageError: Polars is not installed.
    """
    require("polars", "polars", "data frames", where)
    from polars import DataFrame

    return DataFrame(records, infer_schema_length=None)
