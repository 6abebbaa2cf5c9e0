"""Where the numbers of a model file come from: the data, the prior, or the original file."""

from pathlib import Path

from steelyard.application.export.content import Content
from steelyard.estimation.estimate import Estimate
from steelyard.robot.inertia import INERTIAL_NAMES
from steelyard.robot_file.model_source import read_mechanism

NOTHING = 0.005
"""Share of a parameter that comes from the data below which they do not show it."""


def mass_shares(estimate: Estimate, content: Content) -> dict[str, float]:
    """Share of each link's mass that comes from the data, 0 to 1; the rest is prior."""
    learned, bodies = _learned(estimate), content.robot.bodies
    return {body.name: learned[f"m.{body.name}"] for body in bodies if not body.massless}


def unseen(estimate: Estimate, content: Content) -> tuple[str, ...]:
    """Parameters beside bodies' and base parameters that the data did not see."""
    bodies = {f"{n}.{body.name}" for n in INERTIAL_NAMES for body in content.robot.bodies}
    beside = [name for name, x in _learned(estimate).items() if x < NOTHING and name not in bodies]
    return tuple(dict.fromkeys((*(blind.name for blind in estimate.blind), *beside)))


def _learned(estimate: Estimate) -> dict[str, float]:
    if estimate.standard is None:
        return {}
    names, learned = estimate.standard.parameters.names, estimate.standard.learned
    return dict(zip(names, learned.tolist(), strict=True))


def impossible_kept(content: Content, original: Path) -> tuple[str, ...]:
    """Links that keep what a URDF says, and cannot exist as it says; one sentence each."""
    robot = content.robot
    carried = {body.name for body in robot.bodies}
    carried |= {frame.name for frame in robot.frames if frame.body >= 0}
    flaws = {
        link.name: link.inertia.flaw()
        for link in read_mechanism(original).links
        if link.inertia is not None and link.name not in carried
    }
    return tuple(f"{name}: {flaw}" for name, flaw in flaws.items() if flaw is not None)
