"""The pages of the app as axe-core finds them: all steps, on a screen and a phone, light and dark.

With an argument, pictures of all of them go into that folder, to be looked at.
"""

import sys
import tempfile
from pathlib import Path

from proofs.support.claims import Claim, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from app.guided import (  # noqa: E402
    Visitor,
    serious_faults,
    serving,
    simulated_arm,
    visiting,
)

STEPS = ("Robot", "Logs", "Check", "Identify")
VIEWS = ((1400, "light"), (1400, "dark"), (420, "light"), (420, "dark"))


def main(pictures: Path | None = None) -> list[Claim]:
    """One claim a state of the workspace: with a finding that is wrong, and with a model."""
    with tempfile.TemporaryDirectory() as name:
        arm = Path(name) / "arm"
        arm.mkdir()
        simulated_arm(arm)
        with serving(Path(name) / "workspace") as server, visiting(server.address) as visitor:
            claims = [_looked_at("empty", visitor, pictures)]
            visitor.step("Robot")
            visitor.drop("robot", arm / "arm.urdf")
            visitor.see(".space3d[data-drawn]")
            visitor.step("Logs")
            visitor.drop("logs", arm / "a.csv", arm / "b.csv")
            visitor.see(".picture .main-svg")
            visitor.idle()
            for joint, column in ((0, "q2"), (1, "q1")):
                visitor.page.select_option(f"#position-{joint}", column)
                visitor.idle()
            visitor.step("Check")
            visitor.click("Check the logs")
            visitor.see("text=Go on all the same")
            visitor.idle()
            claims.append(_looked_at("wrong", visitor, pictures))
            visitor.step("Check")
            visitor.page.get_by_role("button", name="Accept").first.click()
            visitor.see("text=Next: identify")
            visitor.step("Identify")
            visitor.click("Identify")
            visitor.see("iframe")
            visitor.idle()
            claims.append(_looked_at("identified", visitor, pictures))
    return claims


def _looked_at(state: str, visitor: Visitor, pictures: Path | None) -> Claim:
    faults = list[str]()
    for width, colours in VIEWS:
        visitor.page.set_viewport_size({"width": width, "height": 900})
        visitor.page.emulate_media(color_scheme=colours)
        for step in STEPS:
            visitor.step(step)
            visitor.idle()
            view = f"{state}, {step}, {width} px, {colours}"
            faults += [f"{view}: {one}" for one in serious_faults(visitor)]
            wide = int(visitor.page.evaluate("document.documentElement.scrollWidth"))
            faults += [f"{view}: {wide} px wide"] * (wide > width)
            if pictures is not None:
                file = f"{state}-{step}-{width}-{colours}.png".lower()
                visitor.page.screenshot(path=str(pictures / file), full_page=True)
    for fault in faults:
        print(fault, file=sys.stderr)
    what = f"serious faults of {len(STEPS) * len(VIEWS)} views, workspace {state}"
    return Claim(what, str(len(faults)), "0", not faults)


if __name__ == "__main__":
    main_of(lambda: main(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
