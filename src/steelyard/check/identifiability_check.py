"""Which parameters logs together identify."""

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add

from steelyard.base.errors import SteelyardError
from steelyard.check.case_logs_and_checks import Case, case_check
from steelyard.check.clean_runs_and_customary_model import clean_runs, customary_model
from steelyard.check.finding import Finding, Fix
from steelyard.estimate.estimate import Unidentifiable
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.model.laws.register import law_of

SHOWN_PARAMETERS = 6
HELPFUL_MOTION = {"m": "other configurations of the joints before"} | dict.fromkeys(
    ("mx", "my", "mz"), "other configurations of the joints up to"
)
"""What shows mass and first moments of a body; other parameters, what their laws say."""


@case_check("identifiability", "What can be identified from these logs?", quick=False)
def identifiability_check(case: Case) -> Iterable[Finding]:
    """Parameters that no log shows; nothing where no run can be made of the logs."""
    runs = clean_runs(case)
    if not runs:
        return
    try:
        regressor = base_regressor(customary_model(case))
        estimate = WeightedLeastSquares()(reduce(add, [gather(regressor, r) for r in runs]))
    except SteelyardError as error:
        yield Finding.doubtful(f"undecided: {error.wrong}", "none", fix=Fix(error.fix))
        return
    left_open = case.loaded.friction and case.reference is None
    of = " (of the model with Coulomb and viscous friction)" if left_open else ""
    seen, blind = len(estimate.parameters.names), estimate.blind
    whole = seen + len(blind)
    says = f"the motion makes {seen} of {whole} base parameters{of} identifiable"
    figure = f"{seen} of {whole}, condition number {estimate.condition_normalised:.3g} (normalised)"
    if blind:
        listed = ", ".join(b.name for b in blind[:SHOWN_PARAMETERS])
        says += f"; not {listed}" + (" and more" if len(blind) > SHOWN_PARAMETERS else "")
        yield Finding.doubtful(says, figure, fix=Fix(_advice(blind)))
    else:
        says += "; how accurately they are identified depends on the noise"
        yield Finding.ok(says, figure)


def _advice(blind: Sequence[Unidentifiable]) -> str:
    wanted: dict[str, list[str]] = {}
    for parameter in blind:
        kind, _, of = parameter.name.partition(".")
        wanted.setdefault(HELPFUL_MOTION.get(kind, law_of(parameter.name).shown_by), []).append(of)
    parts = [f"{help_} {', '.join(dict.fromkeys(names))}" for help_, names in wanted.items()]
    return f"additional motion:  {'; '.join(parts)}"
