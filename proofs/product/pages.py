"""All pages, in headless Chromium: on a screen and a phone, in light and dark, and on paper."""

import sys
import tempfile
from pathlib import Path

from proofs.support.claims import Claim, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from browser import chromium, running  # noqa: E402
from report.conftest import (  # noqa: E402
    comparison,
    comparison_content,
    nasty_content,
    usual_content,
)
from report.pages import PAGES, pages_of, wrong_on_paper, wrong_on_screen  # noqa: E402

VIEWS = ((420, True), (1400, True), (1400, False), (420, False))
"""Widths of the window [px] and whether it is dark; each next one differs in one of both."""

PRINTED = PAGES[:-1]
"""Names without a blank cannot be divided between lines of a narrow table."""


def main() -> list[Claim]:
    """One claim a page and medium."""
    program = chromium()
    if program is None:
        return [Claim("a browser to look with", "none found", "Chromium", False)]
    usual, claims = usual_content(), list[Claim]()
    pages = pages_of(usual, comparison_content(usual, comparison()), nasty_content())
    with tempfile.TemporaryDirectory() as name, running(program, Path(name)) as tab:
        for page, text in pages.items():
            file = Path(name) / "page.html"
            file.write_text(text, encoding="utf-8")
            tab.show(*VIEWS[0])
            tab.open(file)
            claims.append(_claim(f"{page}, on screens", wrong_on_screen(tab, VIEWS)))
            if page in PRINTED:
                claims.append(_claim(f"{page}, on paper", wrong_on_paper(tab)))
    return claims


def _claim(what: str, wrong: list[str]) -> Claim:
    for one in wrong:
        print(f"{what}: {one}", file=sys.stderr)
    return Claim(what, f"{len(wrong)} faults", "0", not wrong)


if __name__ == "__main__":
    main_of(main)
