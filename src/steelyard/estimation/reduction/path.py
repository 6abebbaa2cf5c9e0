"""The backward path: one parameter is removed, the others are refitted, the model is scored."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

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
    """Models from the full one to the smallest.

    Attributes:
        states: The models; each has one parameter less than the one before.
        steps: What was removed from each but the last.
        essential: Parameters without which a model was refused, or that had to stay.
        requested: How many of the first steps were requested, whatever the parameter is worth.
    """

    states: tuple[State, ...]
    steps: tuple[Step, ...]
    essential: tuple[str, ...]
    requested: int = 0

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
        drop: Parameters that are removed first, whatever they are worth.
        accepts: Whether a model may be one of the path.
    """
    first = state = full.state(range(len(full.names)))
    essential = dict.fromkeys(keep)
    states, steps, requested = [first], list[Step](), 0
    wanted = [full.names.index(name) for name in drop if name in full.names]
    while len(state.active) > 1:
        free = [k for k, name in enumerate(state.names) if name not in essential]
        asked = [k for k in free if state.active[k] in wanted]
        if not free:
            break
        worth = criterion.worth(state)
        place = min(asked or free, key=lambda k: worth[k])
        name, cost = state.names[place], float(state.losses[place])
        smaller = state.without(state.active[place])
        if not asked and not accepts(first, smaller):
            essential[name] = None
            continue
        state = smaller
        states.append(state)
        steps.append(Step(name, cost))
        requested += bool(asked)
    return Path(tuple(states), tuple(steps), tuple(essential), requested)
