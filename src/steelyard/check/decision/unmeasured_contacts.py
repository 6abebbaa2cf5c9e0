r"""Is all that touches a robot with a floating base measured, and on which link is it not?

Free bodies would take up a force that lasts, so the nominal ones are taken, up to one factor. An
unmeasured wrench $W$ on the base is one $F$ on a link, $W = J_b^T F$, if the efforts $J^T F$ of the
joints to that link are missing too.
"""

from collections.abc import Iterator

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check
from steelyard.check.decision.small_errors_beside_free_bodies import explained, placed
from steelyard.check.finding import Finding, Fix
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES, OFFSET_COLUMN
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.model.equations.frame_and_point_kinematics import frame_kinematics

OTHER_MASS = 0.6
"""Masses that contacts ask for over the model file's, less 1, that no model file is off by."""
MISSING_FORCE = 0.1  # force on the base that nothing explains, over the robot's weight, to be one
EXPLAINED_JOINTS = 0.5  # share of the joints' residuals that a link leaves if something acts on it
SECOND_BEST = 1.3  # share that the second best link leaves over that of the best


@log_check("unmeasured contacts", "Is all that touches the robot measured?")
def unmeasured_contacts_check(case: Case, log: CheckedLog) -> Finding | None:
    """A force on the base that nothing explains, and the link that it acts on."""
    reading, base = explained(case, log), log.recording.signals.base
    if reading is None or base is None or not base.wrench_known:
        return None
    return _unmeasured(placed(reading))


def _unmeasured(reading: Reading) -> Finding:
    motion = reading.motion()
    predicted = reading.predicted(*motion) - reading.pushed(*motion)
    y, moving = reading.columns(predicted)
    own = reading.score.nuisances.copy()
    own[:, OFFSET_COLUMN] = 0.0  # which takes up a force that lasts
    friction = np.einsum("jk,jkb->jb", own, y[:, :NUISANCES])
    left = (reading.efforts() - predicted - friction) * moving
    weight, force = reading.predicted(*motion)[:3], left[:3]
    share = float(np.sum(weight * force) / max(float(np.sum(np.square(weight))), 1e-300))
    force = force - share * weight  # a mass that is off is no contact
    size = float(np.sqrt(np.mean(np.sum(np.square(weight), axis=0))))
    missing = float(np.sqrt(np.mean(np.sum(np.square(force), axis=0)))) / max(size, 1e-300)
    figure = (
        f"force on the base that masses do not explain {100.0 * missing:.2g} % of the weight, at "
        f"most {100.0 * MISSING_FORCE:.0f} % allowed"
    )
    figure += f"; masses {100.0 * share:+.0f} % of the model file's"
    if missing < MISSING_FORCE and abs(share) < OTHER_MASS:
        return Finding.ok("contacts that are measured carry the robot", figure)
    wide = np.maximum(np.sqrt(np.mean(np.square(reading.efforts()), axis=1)), 1e-12)
    shares = sorted(_shares(reading, motion[0], left, wide))
    fix = Fix(
        "name all contacts as [[signals.base.contacts]] with their forces, or the wrench as "
        'unknown (wrench = "unknown" in [signals.base]) if only the base is held'
    )
    best, link = shares[0]
    if best < EXPLAINED_JOINTS and (len(shares) < 2 or shares[1][0] > SECOND_BEST * best):
        says = f"something that is not measured acts on '{link}'"
        figure += f"; a force there explains {100.0 * (1.0 - best):.0f} % of the joints' residuals"
        return Finding.wrong(says, figure, fix=fix)
    says = "something that is not measured acts on the robot, or contacts are not as declared"
    return Finding.doubtful(says, figure, fix=fix)


def _shares(reading: Reading, q: Array, left: Array, wide: Array) -> Iterator[tuple[float, str]]:
    """Share of the joints' residuals that is left if a wrench acts on a link, and its name."""
    log, robot = reading.likelihood, reading.knowledge.robot
    first = log.signals.n_base
    rows = slice(first, None)
    own = left[rows] / wide[rows, None]
    whole = max(float(np.sum(np.square(own))), 1e-300)
    parents = {body.parent for body in robot.bodies}
    for k, body in enumerate(robot.bodies):
        if k in parents and k > 0:
            continue
        _, _, jacobian = frame_kinematics(robot, body.name)(q.T)
        wrench = np.linalg.solve(
            jacobian[:, :, :first].transpose(0, 2, 1), left[:first].T[..., None]
        )
        efforts = (jacobian[:, :, rows].transpose(0, 2, 1) @ wrench)[..., 0].T
        rest = own - efforts / wide[rows, None] * (left[rows] != 0.0)
        yield float(np.sum(np.square(rest))) / whole, body.name
