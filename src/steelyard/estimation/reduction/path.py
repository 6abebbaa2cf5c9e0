"""The backward path: one parameter is removed, the others are refitted, the model is scored."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

from steelyard.errors import DataError
from steelyard.estimation.reduction.criteria import Criterion
from steelyard.estimation.reduction.state import FullModel, State

Accepts = Callable[[State, State], bool]
"""Whether a model may lose a parameter: the full model, and the one without it."""


@dataclass(frozen=True)
class Step:
    """One removal.

    Attributes:
        name: The parameter.
        cost: Rise of chi-squared by it, see `State.losses`.
    """

    name: str
    cost: float


@dataclass(frozen=True, eq=False)
class Path:
    """Models from the first one, without what was requested to go, to the smallest.

    Attributes:
        states: The models; each has one parameter less than the one before.
        steps: What was removed from each but the last.
        essential: Parameters without which a model was refused, or that had to stay.
        requested: What the first model lacks already, whatever it is worth.
    """

    states: tuple[State, ...]
    steps: tuple[Step, ...]
    essential: tuple[str, ...]
    requested: tuple[Step, ...] = ()

    @property
    def full(self) -> FullModel:
        """The full model."""
        return self.states[0].full

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of parameters of each model."""
        return tuple(len(state.active) for state in self.states)


def backward(
    full: FullModel,
    criterion: Criterion,
    *,
    keep: Collection[str] = (),
    drop: Collection[str] = (),
    accepts: Accepts = lambda full, smaller: True,
) -> Path:
    """Backward stepwise selection, [Volkmann] algorithm 1 for any criterion.

    In each step the parameter that is worth least, and is not essential, is removed and the
    others are refitted. Where `accepts` refuses the smaller model, the parameter becomes essential
    instead. The path ends where all parameters that are left are essential, or one is left.

    Args:
        full: The full model.
        criterion: What a parameter is worth.
        keep: Parameters that are essential from the start.
        drop: Parameters that the first model of the path lacks, whatever they are worth.
        accepts: Whether a model may be one of the path.

    Raises:
        DataError: No parameter is left without those to drop.
    """
    complete = state = full.state(range(len(full.names)))
    essential, wanted = dict.fromkeys(keep), set(drop)
    if wanted.issuperset(full.names):
        raise DataError(
            "all parameters that the data show are to be removed",
            where=", ".join(full.names[:4]),
            fix="remove fewer",
        )
    requested, steps = list[Step](), list[Step]()
    while free := [name for name in state.names if name in wanted]:
        step, state = _without_least(state, free, criterion)
        requested.append(step)
    states = [state]
    while len(state.active) > 1:
        if not (free := [name for name in state.names if name not in essential]):
            break
        step, smaller = _without_least(state, free, criterion)
        if accepts(complete, smaller):
            state = smaller
            states.append(state)
            steps.append(step)
        else:
            essential[step.name] = None
    return Path(tuple(states), tuple(steps), tuple(essential), tuple(requested))


def _without_least(state: State, free: Collection[str], criterion: Criterion) -> tuple[Step, State]:
    """The removal of the parameter that is worth least of some, and the model without it."""
    worth = criterion.worth(state)
    place = min((state.names.index(name) for name in free), key=lambda k: worth[k])
    step = Step(state.names[place], float(state.losses[place]))
    return step, state.without(state.active[place])
