"""Friction that falls when motion begins, by another amount in each direction."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.laws.stribeck import Stribeck
from steelyard.model.terms.axes import Axes, directional, directions


@dataclass(frozen=True)
class DirectionalStribeck(Stribeck):
    r"""Stribeck friction of its own in each direction.

    $$ f = \bigl(f_+ s_+(v) + f_- s_-(v)\bigr)\,e^{-|v/v_s|^\beta}, \qquad s_\pm = (s \pm |s|)/2 $$

    To be added to `directional_coulomb`, or to `coulomb` and `offset`. Its fields are those of
    `Stribeck`.
    """

    law: ClassVar[str] = "directional_stribeck"
    units: ClassVar[Mapping[str, str]] = {"_forward": "{effort}", "_backward": "{effort}"}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The direction of motion, its positive and its negative part, fading with speed."""
        sense = directions(axes, state.dq, self.smoothing, self.law, self.shape)
        fading = self.fading(axes, state.dq)
        return [s * x for s, x in zip(directional(sense), fading * 2, strict=True)]
