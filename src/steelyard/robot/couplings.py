"""Couplings of joints that are no proportion: their joints have to be locked."""

from collections.abc import Collection, Mapping

from steelyard.errors import OpenModelError
from steelyard.robot.mechanism import Mechanism


def refuse_coupled(
    mechanism: Mechanism, masters: Mapping[str, str], moving: Collection[str]
) -> None:
    """Raise if a joint moves that a coupling ties.

    Args:
        mechanism: The mechanism.
        masters: By joint, the joint that it follows, or itself.
        moving: Names of the joints that move.
    """
    for coupling in mechanism.couplings:
        tied = dict.fromkeys(masters[name] for name in coupling.joints if name in masters)
        if not any(name in moving for name in tied):
            continue
        lines = ", ".join(f"{name} = {mechanism.rest.get(name, 0.0):.6g}" for name in tied)
        raise OpenModelError(
            f"joints are tied by {coupling.what}, which is not supported: "
            + ", ".join(coupling.joints),
            where=coupling.where,
            fix=f"lock them: {lines} under [robot.locked] in a robot file, as `steelyard init` "
            "writes it",
        )
