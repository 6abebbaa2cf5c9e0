"""Friction that grows with a power of speed."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms.axes import Axes
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import Place, as_one, curve_over_speed

CREEP = 1e-12
"""Speed up to which the root is a straight line, so that its slope stays finite [rad/s; m/s]."""


class _OfSpeed(ActsOnAxes):
    """One parameter per coordinate, not negative, times a function of its speed."""

    dissipation: ClassVar[Dissipation] = "together"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds of"

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        return [self.curve(axis.of(state.dq)) for axis in axes]

    @abstractmethod
    def curve(self, speed: Scalar) -> Scalar:
        """Friction per unit of the parameter; odd."""


@dataclass(frozen=True)
class Quadratic(_OfSpeed):
    r"""Friction with the square of speed, $f = f_2\,|v|\,v$: turbulent oil, fans."""

    law: ClassVar[str] = "quadratic"
    in_model_files: ClassVar[Place] = as_one("quadratic")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/({speed})²"}

    def curve(self, speed: Scalar) -> Scalar:
        """The square with the speed's sign."""
        return np.abs(speed) * speed


@dataclass(frozen=True)
class Cubic(_OfSpeed):
    r"""Friction with the cube of speed, $f = f_3\,v^3$."""

    law: ClassVar[str] = "cubic"
    in_model_files: ClassVar[Place] = as_one("cubic")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/({speed})³"}

    def curve(self, speed: Scalar) -> Scalar:
        """The cube."""
        return speed * speed * speed


@dataclass(frozen=True)
class Root(_OfSpeed):
    r"""Friction with the root of speed, $f = f_{1/2}\,\sqrt{|v|}\,\mathrm{sign}(v)$: grease."""

    law: ClassVar[str] = "root"
    in_model_files: ClassVar[Place] = curve_over_speed("friction with the root of speed")
    units: ClassVar[Mapping[str, str]] = {"": "{force}/√({speed})"}

    def curve(self, speed: Scalar) -> Scalar:
        """The root with the speed's sign."""
        return speed / np.sqrt(np.maximum(np.abs(speed), CREEP))
