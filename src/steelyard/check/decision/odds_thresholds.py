"""Thresholds of the decision between readings of a log, on natural logarithms of odds.

Where bodies are not known, odds are those of `hypotheses.evidence_with_unknown_bodies`, which
counts a joint for a limited number of samples and never leaves less than a floor; with a reference
they are those of the nominal misfits.
"""

SURE = 20.0
"""Log odds of what a reading says of a cause, over all readings that say otherwise, from which on
it is wrong and a line is written: errors of models weigh as much as 10 on invented robots."""
LIKELY = 8.0  # log odds from which on it is doubtful
ANSWERED = 10.0  # log odds by which all alternatives must be behind for a question to be answered
ROUGH_MISFIT = 25.0  # misfit [%] that a reading may leave in the typical joint to be one
HEAVIEST_FACTOR = 6.0  # on all efforts, before the links of a nominal model are no excuse
NOTICED_FACTOR = 2.0  # on all efforts, from which on bodies of another size are mentioned
FAIR_BODIES_MISFIT = 5.0  # misfit [%] up to which nothing is hidden by it
LEAST_MASS, LEAST_SHARE, SURE_MASS = 0.3, 0.02, 6.0
"""Least payload [kg], relative to the arm's mass, and over its standard deviation."""
LEAST_FALL = 2.0  # fall of some joint's misfit that a reading needs against a reference
LEAST_DELAY = {True: 0.004, False: 0.04}  # least delay [s], with and without a reference
DELAY_ROWS = 1.5  # the same in rows of the log
LATE_MARGIN = 12.0  # sharper log-likelihood that a delay must gain
EXPLAINED_BY_FRICTION, FRICTION_FALL = 60.0, 2.0
"""Log-likelihood that bodies must gain, and the factor by which the misfit of some joint must fall,
beside friction alone."""
MIRROR_FALL = 1.5
"""Misfit of mirrored bodies, over that of the best ones, up to which both fit: no log tells the two
apart but by the nominal bodies, which may be wrong."""
