"""The last link as a rival: its mass properties in the model file are not those of the robot.

Where most of an arm's mass is in its last link, an error of that link in the model file changes the
efforts of all joints by about one factor, and looks like a gain. A heavier link is the same as a
payload; a lighter one is not, and has to be a body that can exist.
"""

from collections.abc import Iterator

from steelyard.diagnosis.hypotheses.possible import other_link
from steelyard.diagnosis.hypotheses.reading import Reading
from steelyard.diagnosis.hypotheses.rival import FREE, Rival, one_of
from steelyard.diagnosis.hypotheses.trial import Trial
from steelyard.estimation.payload.load_case import carrier

OWN_FILE = "payload"
"""The suspicion that an explanation by the last link belongs to."""
AGREES = 12.0
"""Typical misfit [%] that one link alone may leave."""
SAME = 0.01
"""Change of the mass, over the link's, up to which its centre and inertia are what differs."""


def link_rivals(trial: Trial, reading: Reading) -> Iterator[Rival]:
    """The last link with mass properties of its own, if these alone explain the efforts.

    Args:
        trial: A log of a robot of which only the model file is known.
        reading: How it is read so far.
    """
    ten = other_link(trial, reading)
    if ten is None:
        return
    body = trial.knowledge.robot.bodies[carrier(trial.knowledge.robot).body]
    changed = reading.changed(payload=ten)
    score = one_of(trial.score(changed), 0)
    if float(score.percent) <= AGREES:
        says = _words(body.name, float(ten[0]), body.inertia.mass)
        yield Rival(OWN_FILE, says, changed, 10.0 * FREE, (), score, fixed=False)


def of_link(rival: Rival) -> bool:
    """Whether an explanation is that the last link differs from the model file."""
    return rival.cause == OWN_FILE and not rival.fixed


def _words(name: str, more: float, mass: float) -> str:
    if abs(more) <= SAME * mass:
        return f"centre of mass or inertia of '{name}' differ from the model file"
    heavier = "heavier" if more > 0.0 else "lighter"
    off = f"'{name}' is about {abs(more):.2g} kg {heavier}"
    return f"{off} than the {mass:.2g} kg of the model file"
