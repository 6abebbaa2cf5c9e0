"""The documents name what is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]


def test_every_citation_is_in_the_references() -> None:
    known = set(
        re.findall(r"^\| (\w+\d{4}) \|", (ROOT / "docs/references.md").read_text("utf-8"), re.M)
    )
    cited = {
        key
        for path in (ROOT / "src").rglob("*.py")
        for key in re.findall(r"\[([A-Z][A-Za-z]+\d{4})", path.read_text("utf-8"))
    }
    assert cited == known


def test_links_and_paths_lead_somewhere() -> None:
    missing = []
    for document in DOCUMENTS:
        text = document.read_text("utf-8")
        links = re.findall(r"\]\((?!https?:)([^)#\s]+)", text)
        missing += [link for link in links if not (document.parent / link).exists()]
        paths = re.findall(r"`((?:src|tests|docs|examples)/[\w/.]+)", text)
        missing += [path for path in paths if not (ROOT / path).exists()]
    assert missing == []
