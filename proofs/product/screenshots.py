"""Pictures of all pages, 1400 and 420 px wide, light and dark; and what is wrong with them.

The pages are those of the demonstration (its motion, its model, a comparison of estimators), the
model of a UR10e, contacts and drift of the tutorial's UR10e, and the check of a Rokae AR5 whose
mounting is not declared. The pictures are for people: they go to the folder that is given,
`python -m proofs.product.screenshots FOLDER`, or away.
Those of `docs/images` are in its folder `docs`.
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from proofs.robots.scores import EXAMPLES, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, data_folder, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from browser import Tab, chromium, running  # noqa: E402

WIDTHS = (1400, 420)

DOCS = {
    "demo_model": ("report.png", ("verdict", "effort"), 1400),
    "demo_motion": ("motion.png", ("design", "design-tool"), 1300),
    "ur10e_contact": ("contact.png", ("contacts", "residuals"), 1130),
    "ur10e_health": ("health.png", ("drift", "joints", "windows"), 1180),
    "ar5_check": ("check.png", ("verdict", "evidence"), 860),
}
"""Pictures of the documentation: by page the file, the sections that are in it, and its height."""

DOCS_WIDTH = 1240


def pages(folder: Path) -> Iterator[tuple[str, Path]]:
    """Make all pages in a folder; their names and files."""
    robot, log = "demo/robot/demo_arm.toml", "demo/robot/identification.csv"
    yield "demo_motion", _made(folder / "demo", "motion/report.html", "demo")
    yield "demo_model", folder / "demo/results/report.html"
    yield "demo_compare", _made(folder / "compare", "compare.html", "compare", robot, log)
    ur10e = (str(EXAMPLES / "ur10e.toml"), *ur10e_logs(), "--validate", ur10e_validation())
    yield "ur10e_model", _made(folder / "ur10e", "report.html", "identify", *ur10e)
    yield from _tutorial(folder)
    example = (EXAMPLES / "rokae_ar5.toml").read_text(encoding="utf-8")
    undeclared = re.sub(r"(?m)^gravity = .*\n", "", example)
    (folder / "rokae_ar5.toml").write_text(undeclared, encoding="utf-8")
    ar5 = ("rokae_ar5.toml", str(data_folder() / "rokae_ar5/ar5_run1_rows0_2300.parquet"))
    yield "ar5_check", _made(folder / "ar5", "check.html", "check", *ar5)


def _tutorial(folder: Path) -> Iterator[tuple[str, Path]]:
    """The pages of the tutorial that puts a model to use."""
    ur10e = data_folder() / "ur10e"
    names = ("ur-20_02_12-40sec_12harm", "ur-20_02_10-30sec_12harm")
    free = ("ur-19_12_23_free", "ur-20_01_31-unload", "ur-20_02_19_14harm50sec")
    fitted, days = (
        [str(ur10e / "identification" / f"{name}.parquet") for name in some]
        for some in (names, free)
    )
    _made(folder / "arm", "model.json", "identify", str(EXAMPLES / "ur10e.toml"), *fitted)
    pushed = str(ur10e / "collision" / "ur-20_01_22-push_pose_1.parquet")
    rests = map(str, sorted((ur10e / "validation").glob("*.parquet")))
    contact = ("arm", pushed, "--calibrate", *rests, *days[:2], "--rate", "6")
    yield "ur10e_contact", _made(folder / "contact", "report.html", "contact", *contact)
    yield "ur10e_health", _made(folder / "health", "report.html", "health", "arm", *days)


def _made(output: Path, page: str, *arguments: str) -> Path:
    """The page that a command writes to its output folder."""
    command = [sys.executable, "-m", "steelyard", *arguments, "-o", output.name]
    done = subprocess.run(command, cwd=output.parent, capture_output=True, text=True)
    assert (output / page).exists(), done.stderr
    return output / page


def faults(tab: Tab, name: str, page: Path, pictures: Path) -> list[str]:
    """Take the four pictures of a page; what sticks out, is too faint, or went wrong."""
    found = list[str]()
    tab.show(WIDTHS[0])
    tab.open(page)
    for width in WIDTHS:
        for theme in ("light", "dark"):
            tab.show(width, theme == "dark")
            tab.run("drawn()")
            tab.picture(pictures / f"{name}_{width}_{theme}.png")
            for check in ("overflow()", "contrast()"):
                found += [f"{name}, {width} px, {theme}: {fault}" for fault in tab.run(check)]
    if name in DOCS:
        _for_docs(tab, *DOCS[name], pictures)
    return found + [f"{name}: {line}" for line in tab.console]


def _for_docs(tab: Tab, file: str, sections: Sequence[str], height: int, pictures: Path) -> None:
    """Take a picture of some sections of the page, of a verdict only the beginning."""
    others = "".join(f":not(#{section})" for section in sections)
    unwanted = f"main > section{others}, .facts ~ *, #verdict > details ~ *"
    tab.run(f"document.querySelectorAll('{unwanted}').forEach(one => one.remove())")
    tab.show(DOCS_WIDTH)
    tab.run("drawn()")
    (pictures / "docs").mkdir(exist_ok=True)
    tab.picture(pictures / "docs" / file, height)


def main(kept: Path | None = None) -> list[Claim]:
    """Make the pages, and look at each; the pictures go to the folder `kept`, if any."""
    program = chromium()
    if program is None:
        return [Claim("a browser to look with", "none found", "Chromium", False)]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        pictures = kept or folder / "pictures"
        pictures.mkdir(parents=True, exist_ok=True)
        with running(program, folder) as tab:
            found = [fault for what in pages(folder) for fault in faults(tab, *what, pictures)]
    print("\n".join(found), file=sys.stderr)
    return [Claim("faults of seven pages, four pictures each", f"{len(found)}", "0", not found)]


if __name__ == "__main__":
    main_of(lambda: main(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
