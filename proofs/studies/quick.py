"""Every study in its quick form, as a program of its own: its page is whole, no bound missed."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from proofs.support.claims import Claim, main_of

ROOT = Path(__file__).parents[2]


def main() -> list[Claim]:
    """One claim a study."""
    claims = []
    for study in sorted((ROOT / "studies").glob("p[1-9]_*.py")):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, str(study), "-o", f"{folder}/out", "--quick"]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            lacks = lacking(study.stem.split("_")[0], Path(folder, "out"), done.stdout)
        last = (done.stderr.strip().splitlines() or [""])[-1] if done.returncode else ""
        result = f"exit {done.returncode} {last}".strip()
        claims.append(Claim(f"{study.stem}, quick", result, "exit 0", done.returncode == 0))
        pages = ", ".join(lacks) or "nothing"
        claims.append(Claim(f"{study.stem}, its pages lack", pages, "nothing", not lacks))
    return claims


def lacking(name: str, folder: Path, out: str) -> list[str]:
    """What a study neither prints nor writes."""
    files = [folder / f"{name}.{kind}" for kind in ("html", "md")]
    if not all(file.is_file() for file in files):
        return ["pages"]
    page, markdown = (file.read_text(encoding="utf-8") for file in files)
    pictures = re.findall(r"\]\((.+?\.svg)\)", markdown)
    tables = re.findall(r"^\| --- \|", markdown, re.MULTILINE)
    parts = {
        "bounds": "Bounds" in out and not re.search(r"\bNO$", out, re.MULTILINE),
        "pictures": page.count("<svg") == len(pictures) > 0,
        "tables": page.count("<table>") == len(tables) >= 2,
        "files of pictures": all((folder / picture).is_file() for picture in pictures),
        "files of the first seed": any((folder / "seed_00").iterdir()),
    }
    return [part for part, there in parts.items() if not there]


if __name__ == "__main__":
    main_of(main)
