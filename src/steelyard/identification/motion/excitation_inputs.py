"""The inputs of `steelyard excite`: tables, options, formats, and an earlier model."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import DataError
from steelyard.estimation.identified import IdentifiedModel, load_model
from steelyard.excitation.bases.families import FAMILIES, basis_of
from steelyard.excitation.export.export import EXPORTS, exported
from steelyard.excitation.export.points import grid_times
from steelyard.excitation.previous_model import Earlier
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.trajectories.minimum_jerk import through_postures
from steelyard.robot_file.excitation_sections import changed_excitation
from steelyard.robot_file.loaded import LoadedRobot


def with_options(loaded: LoadedRobot, **options: Any) -> LoadedRobot:
    """The robot with what options say in the place of its `[excitation]` tables.

    Raises:
        DataError: An option does not fit the kind of motion.
    """
    try:
        section = changed_excitation(loaded.excitation, **options)
    except ValueError as error:
        raise DataError(
            str(error), where="options of steelyard excite", fix="see steelyard excite --help"
        ) from None
    return replace(loaded, excitation=section)


def refuse_formats(loaded: LoadedRobot, formats: Sequence[str], rate: float | None) -> None:
    """Formats that do not exist or cannot hold the motion, before any time is spent on it.

    Raises:
        OutputError: One cannot.
    """
    robot, section = loaded.robot, loaded.excitation.motion
    zero = np.zeros(robot.n)
    still = through_postures([zero, zero], 1.0)
    motion: ExactTrajectory = still
    if section.kind in FAMILIES:
        basis = basis_of(section, robot)
        motion = basis.motion(basis.still(zero) + 1e-3)
    for form in formats:
        if form == "csv" and (rate is None or 0.0 < rate < np.inf):
            grid_times(motion.duration, rate or EXPORTS[form].rate)
        exported(still if form == "csv" else motion, robot, form, rate)


def earlier_of(identified: IdentifiedModel) -> Earlier:
    """What an identified model knows for the design of a motion."""
    estimate = identified.estimate
    return Earlier(
        estimate.sigma,
        identified.cutoffs.matched,
        estimate.parameters.names,
        estimate.parameters.values,
        estimate.covariance,
        estimate.values.as_dict(),
        (*(one.name for one in estimate.removed), *estimate.known),
    )


def identified_before(
    earlier: str | Path | IdentifiedModel, loaded: LoadedRobot
) -> IdentifiedModel:
    """An earlier model of the robot.

    Raises:
        DataError: It is of another robot, or knows no noise.
    """
    known = load_model(earlier)
    where = "earlier model" if isinstance(earlier, IdentifiedModel) else str(earlier)
    theirs, ours = known.model.robot.joint_names, loaded.robot.joint_names
    if theirs != ours:
        raise DataError(
            f"the earlier model moves the joints {', '.join(theirs)}, this robot {', '.join(ours)}",
            where=where,
            fix="give a model that was identified with this robot file",
        )
    if not (known.estimate.sigma > 0.0).all():
        raise DataError(
            "the earlier model fits a joint's efforts without any noise",
            where=where,
            fix="leave --earlier out: noise is then assumed",
        )
    return known
