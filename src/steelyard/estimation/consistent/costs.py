"""What constraints and prior cost the fit, with the ones that are active, for people to read."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.consistent.active_bounds import active_bounds, contradicted
from steelyard.estimation.consistent.prior_weight import LEAST, Tried, Weighed
from steelyard.estimation.consistent.program import Program, conic_constraints
from steelyard.estimation.knowledge import Knowledge

EDGE = 0.02
"""Least eigenvalue of a body's `X` below which it is at the edge of consistent bodies."""

NAMED = 6
"""Active constraints that a note names."""

Attempt = Callable[[Program, float], Tried]
"""The solution of a program with a weight of the prior."""

Spread = Callable[[Program, Tried], Array]
"""Covariance of the unknowns of a solution, shape `(m, m)`."""


def cost_notes(
    program: Program, knowledge: Knowledge, found: Weighed, attempt: Attempt, spread: Spread
) -> tuple[str, ...]:
    """What contradicts the data: knowledge, physical constraints, or the prior.

    Args:
        program: The program.
        knowledge: What its constraints and priors are made of.
        found: Its solution.
        attempt: Solves a program.
        spread: Covariance of a solution's unknowns.
    """
    rank, gamma, rise, notes = len(program.unknowns.vector), found.tried.gamma, found.tried.rise, []
    try:
        if knowledge.rows:
            knowledge = replace(knowledge, rows=())
            bare = replace(program, constraints=conic_constraints(program.unknowns, knowledge))
            free = attempt(bare, gamma)
            if against := contradicted(program, free.u, spread(bare, free)):
                notes.append(
                    f"the data contradict the prior constraints, which raise χ² by "
                    f"{rise - free.rise:.4g}: {'; '.join(against)}"
                )
            program, rise = bare, free.rise
        if (found.physics or rise > rank) and (
            physical := _physical(program, knowledge, attempt, spread)
        ):
            return (*notes, physical)
    except DataError:
        return tuple(notes)
    if rise > 2.0 * rank and any(program.unknowns.priors):
        notes.append(
            f"a prior with this uncertainty raises χ² by {rise:.4g}, where up to {rank} is within "
            "noise: the data contradict it"
        )
    return tuple(notes)


def _physical(
    program: Program, knowledge: Knowledge, attempt: Attempt, spread: Spread
) -> str | None:
    """What bounds and consistent bodies cost without a prior; nothing if noise explains it."""
    whole = attempt(program, LEAST)
    if whole.rise <= len(program.unknowns.vector):
        return None
    bodies = {k for body in range(len(knowledge.bodies)) for k in knowledge.tens(body)}
    laws = [k not in bodies for k in range(len(knowledge.names))]
    unbounded = replace(
        knowledge,
        lower=np.where(laws, -np.inf, knowledge.lower),
        upper=np.where(laws, np.inf, knowledge.upper),
        curves=(),
    )
    alone = attempt(
        replace(program, constraints=conic_constraints(program.unknowns, unbounded)), LEAST
    )
    at = active_bounds(program, whole.u, spread(program, whole)).names
    thin = np.linalg.eigvalsh(program.unknowns.pseudo(whole.u))[:, 0] <= EDGE
    edges = [name for name, near in zip(knowledge.bodies, thin, strict=True) if near]
    parts = (
        (whole.rise - alone.rise, "bounds of", grouped(at, knowledge.names)),
        (alone.rise, "valid inertia of", edges),
    )
    named = [
        f"{kind} {_some(names)} ({cost:.4g})"
        for cost, kind, names in sorted(parts, key=lambda part: -part[0])
        if names and cost > 0.05 * whole.rise
    ]
    active = f"; active: {'; '.join(named)}" if named else ""
    return (
        f"physical constraints (valid inertias, bounds such as friction >= 0) raise χ² by "
        f"{whole.rise:.4g} even without a prior{active}: a term is missing or wrong"
    )


def grouped(names: Sequence[str], every: Sequence[str]) -> list[str]:
    """Names of parameters; a law of which all are among them is `law.*`."""
    found: dict[str, None] = {}
    for name in names:
        law = name.split(".")[0]
        family = [other for other in every if other.split(".")[0] == law]
        whole = len(family) > 1 and set(family) <= set(names)
        found[f"{law}.*" if whole else name] = None
    return list(found)


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
