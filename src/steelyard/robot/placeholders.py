"""Numbers in model files that stand where nobody knew one."""

_FROM, _BEYOND = 3, 1e6
"""Powers of ten from this one on, and efforts beyond, that nobody has measured."""


def is_placeholder(effort: float) -> bool:
    """Whether a limit of effort [Nm; N] only fills its place.

    That is what is not above zero; 1000, 10000, ... and one below these (999, 99999); and all from
    a million on. An infinite limit says itself that there is none.
    """
    powers = (10**power for power in range(_FROM, 7))
    rounded = any(effort in (power, power - 1) for power in powers)
    return effort <= 0.0 or rounded or _BEYOND <= effort < float("inf")
