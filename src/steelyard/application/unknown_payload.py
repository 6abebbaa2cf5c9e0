"""A payload in a log that the model does not have."""

from steelyard.application.payload import identify_payload
from steelyard.errors import SteelyardError
from steelyard.estimation.estimate import Z95
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.payload.load import PayloadEstimate
from steelyard.regression.information import Information

CERTAIN = 3.0
"""Standard deviations of its mass from which on there is one."""

LEAST = 0.02
"""Least mass that is reported, over that of the moving links."""


def unknown_payload(identified: IdentifiedModel, run: Information) -> PayloadEstimate | None:
    """What a run carries beyond doubt; `None` if there is nothing, or no way to know.

    Args:
        identified: The robot without it.
        run: What the run says, efforts as logged.
    """
    if identified.signals.effort_kind == "gravity_compensated_torque":
        return None
    try:
        found = identify_payload(identified, [run])
    except SteelyardError:
        return None
    least = LEAST * sum(body.inertia.mass for body in identified.model.robot.bodies)
    heavy = found.mass > max(least, CERTAIN / Z95 * float(found.half_width[0]))
    return found if heavy else None


def payload_words(found: PayloadEstimate, run: str) -> str:
    """What to say of it."""
    return (
        f"the efforts of {run} are those with a payload of {found.mass:.2f} ± "
        f"{found.half_width[0]:.2f} kg on '{found.body}' that the model does not have, or with "
        "other drive gains: see steelyard payload"
    )
