r"""Load-dependent friction beyond that of any gear.

With $f = \mu\,|\tau|\,s$ the drive gives $(1 + \mu)\,\tau$ to lift a load of $\tau$: the efficiency
is $1 / (1 + \mu)$. At $\mu = 1$ a gear locks itself, as the drive need not hold the load.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.estimation.estimate import Z95, Estimate
from steelyard.terms.laws.load_dependent import PLAUSIBLE, LoadDependent

CAUSES = "a gain or gear ratio is wrong, a term is missing, or the motion has too few loads"


@dataclass(frozen=True)
class Coefficient:
    """Friction over load at a coordinate, and half its 95 % interval."""

    name: str
    value: float
    half_width: float

    @property
    def words(self) -> str:
        """Value, interval and the efficiency that it means."""
        share = 100.0 / (1.0 + self.value)
        return f"{self.name} {self.value:.2f} ± {self.half_width:.2g} (efficiency {share:.0f} %)"


class LoadFriction:
    """Coefficients of load-dependent friction above those of gears."""

    name: ClassVar[str] = "load-dependent friction"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding after a fit: doubtful if an interval lies wholly above `PLAUSIBLE`.

        None if all that are above have intervals down to zero: these are poorly identified, and
        counted as such.
        """
        found = tuple(_implausible(case.identified.estimate)) if case.fitted else ()
        if not any(one.value > one.half_width for one in found):
            return ()
        sure = any(one.value - one.half_width > PLAUSIBLE for one in found)
        listed = ", ".join(one.words for one in found)
        return (
            Finding(
                self.name,
                "",
                Severity.DOUBTFUL if sure else Severity.OK,
                f"load-dependent friction of {listed} is more than a gear has (at most about "
                f"{PLAUSIBLE:g} of the load, and a gear locks itself at 1): {CAUSES}",
                "",
                tuple(one.name for one in found),
                Fix(
                    "Check gains and gear ratios of these joints, and log them moving in both "
                    "directions under several loads"
                ),
                headline=True,
                brief=f"load-dependent friction above that of gears ({PLAUSIBLE:g}): {listed}. "
                f"{CAUSES[0].upper()}{CAUSES[1:]}",
            ),
        )


def _implausible(estimate: Estimate) -> Iterator[Coefficient]:
    names = estimate.parameters.names
    for name, value, std in zip(names, estimate.parameters.values, estimate.std, strict=True):
        law, _, coordinate = name.partition(".")
        if law == LoadDependent.law and value > PLAUSIBLE:
            yield Coefficient(coordinate, float(value), Z95 * float(std))
