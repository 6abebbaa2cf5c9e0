"""The last link as a hypothesis: its mass properties are not those of the model file.

Where most of an arm's mass is in its last link, an error of that link in the model file changes the
efforts of all joints by about one factor, and looks like a gain. A heavier link is the same as a
payload; a lighter one is not, and has to be a physically consistent body.
"""

from collections.abc import Iterator

from steelyard.diagnosis.hypotheses.hypothesis import FREE, Hypothesis, one_of
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood
from steelyard.diagnosis.likelihood.possible import other_link
from steelyard.estimation.payload.load_case import carrier

OWN_FILE = "payload"
"""The check that an explanation by the last link belongs to."""
AGREES = 12.0
"""Typical misfit [%] that one link alone may leave."""
SAME = 0.01
"""Change of the mass, over the link's, up to which its centre and inertia are what differs."""


def link_hypotheses(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Hypothesis]:
    """The last link with mass properties of its own, if these alone explain the efforts.

    It is not one that outweighs the arm which carries it: efforts are then in another unit.

    Args:
        likelihood: A log of a robot of which only the model file is known.
        interpretation: How it is read so far.
    """
    ten = other_link(likelihood, interpretation)
    arm = sum(body.inertia.mass for body in likelihood.knowledge.robot.bodies)
    if ten is None or abs(float(ten[0])) > arm:
        return
    body = likelihood.knowledge.robot.bodies[carrier(likelihood.knowledge.robot).body]
    changed = interpretation.changed(payload=ten)
    score = one_of(likelihood.score(changed), 0)
    if float(score.percent) <= AGREES:
        says = _words(body.name, float(ten[0]), body.inertia.mass)
        yield Hypothesis(OWN_FILE, says, changed, 10.0 * FREE, (), score, fixed=False)


def of_link(hypothesis: Hypothesis) -> bool:
    """Whether an explanation is that the last link differs from the model file."""
    return hypothesis.cause == OWN_FILE and not hypothesis.fixed


def _words(name: str, more: float, mass: float) -> str:
    if abs(more) <= SAME * mass:
        return f"centre of mass or inertia of '{name}' differ from the model file"
    heavier = "heavier" if more > 0.0 else "lighter"
    off = f"'{name}' is about {abs(more):.2g} kg {heavier}"
    return f"{off} than the {mass:.2g} kg of the model file"
