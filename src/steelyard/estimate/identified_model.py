"""An identified model: what `steelyard identify` writes and everything else reads."""

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, json_values, of_json_values
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError, nearest
from steelyard.base.files import read_json, whole_folder
from steelyard.base.motion import Motion
from steelyard.estimate.covariance_and_band_widths import (
    Calibration,
    EffortUncertainty,
    covariance_root,
    dead_zone,
)
from steelyard.estimate.estimate import Estimate, KnownScales
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import (
    Observer,
    check_bandwidth,
)
from steelyard.estimate.external.wrench_methods_and_observer_step import (
    FORCE,
    LEVER,
    Axes,
    Expected,
)
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.filter_and_gram import noise_bandwidth
from steelyard.estimate.mass_and_centre import MassAndCentre, mass_and_centre
from steelyard.model.compiled_quantity import Stepper
from steelyard.model.dynamics import Dynamics
from steelyard.model.model import Model, ValuedModel
from steelyard.model.torque_and_quantities import TORQUE, Quantity
from steelyard.report.words import first_names
from steelyard.robot.file.signals import Signals, signals_from_dict
from steelyard.robot.robot import Robot, refuse_floating
from steelyard.runs.processing_choices import Processing
from steelyard.runs.run import MotionSamples

MOST_RUNS = 8  # runs that the text names
SCHEMA = "steelyard.model"
SCHEMA_VERSION = 4
OF_ACTUATORS = "steelyard.actuators"  # schema of what is identified from position targets

BAND = 5.0
"""Band of errors that are compared between models [Hz]: the motions of arms lie below it, their
elastic modes mostly above."""

UNKNOWN = 1e3  # standard deviation of a joint without samples, over the largest of the others
LEAST_RESIDUAL_STD = 1e-6  # least standard deviation of residuals, over the largest of all joints


@dataclass(frozen=True)
class Provenance:
    """Where an identified model comes from."""

    version: str
    inputs: Mapping[str, str]  # role and name of every file to its SHA-256
    runs: tuple[str, ...] = ()  # the runs that were fitted, with their cuts
    notes: tuple[str, ...] = ()  # assumptions and automatic choices, for display
    # what checks doubt of the fit: it qualifies every verdict on the model; texts by name
    doubts: tuple[Mapping[str, str], ...] = ()


@dataclass(frozen=True)
class Cutoffs:
    """Cut-off frequencies [Hz] of the fit and of the score."""

    motion: float  # of positions, velocities and accelerations
    matched: float  # of regressor and effort alike
    score: float  # of measured and predicted effort in the validation band
    headline: float = BAND  # of errors that are compared between models; a fixed number


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedModel(Dynamics):
    """A model with estimated values, and how to read logs of its robot.

    It computes all quantities of `Dynamics`, such as `torque(motion)` and `mass_matrix(q)`. Where
    scales of the logged efforts were estimated, these are of the efforts divided by the scales;
    `effort(motion)` has the efforts as logged.

    Attributes:
        model: Robot and terms.
        base: Structural base parameters.
        estimate: Estimated base parameters.
        reference: Other estimates of the same data, by estimator, for comparison.
        signals: Columns of the robot's logs, effort units and gains.
        cutoffs: Filter frequencies.
        provenance: Inputs and settings.
        processing: The chain from rows to motion that logs of the robot go through.
        motions: Rows of the fitted runs, to recognise their motions in other logs.
        calibration: Width of the 95 % bands of predicted efforts; `None` without left-out runs.
        effort_scales: Scales of the efforts that were estimated; already included in the
            gains of `signals`. `None` without.

    Example:
        >>> model = load_model("arm-model")
        >>> model.mass_matrix([0.0, 0.5]).shape
        (2, 2)
        >>> model.gravity([0.0, 0.5]).shape
        (2,)
    """

    model: Model
    base: BaseMap
    estimate: Estimate
    reference: tuple[Estimate, ...]
    signals: Signals
    cutoffs: Cutoffs
    provenance: Provenance
    processing: Processing = Processing()
    motions: tuple[MotionSamples, ...] = ()
    calibration: Calibration | None = None
    effort_scales: KnownScales | None = None

    def __repr__(self) -> str:
        return f"IdentifiedModel({self.model!r})"

    def __str__(self) -> str:
        estimate, robot = self.estimate, self.model.robot
        known = f"{len(estimate.parameters)} of {len(self.base)} base parameters estimated"
        noise = zip(estimate.sigma, robot.effort_units, strict=True)
        return "\n".join(
            [
                f"{robot.name}: {', '.join(robot.joint_names)}",
                f"terms      {', '.join(term.law for term in self.model.terms)}",
                f"estimate   {estimate.estimator}: {known}",
                f"residuals  std {', '.join(f'{sigma:.3g} {unit}' for sigma, unit in noise)}",
                f"fitted to  {first_names(self.provenance.runs, MOST_RUNS)}",
            ]
        )

    @cached_property
    def valued(self) -> ValuedModel:
        """The model with the estimated values."""
        return self.model.at(self.estimate.values)

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.model.robot

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of all arrays."""
        return self.model.robot.joint_names

    def evaluate(self, quantity: Quantity, *arguments: ArrayLike, t: Array | None = None) -> Array:
        """A quantity at one configuration or along samples; see `Dynamics.evaluate`."""
        return self.valued.evaluate(quantity, *arguments, t=t)

    def _along(
        self, quantity: Quantity, q: Motion | ArrayLike, dq: ArrayLike | None, ddq: ArrayLike | None
    ) -> Array:
        found = super()._along(quantity, q, dq, ddq)
        positions = q.q if isinstance(q, Motion) else np.asarray(q, dtype=float)
        if far := far_beyond_limits(self.robot, positions):
            fix = "positions are in rad: use numpy.radians for degrees"
            warnings.warn(f"{far}; {fix}", stacklevel=3)
        return found

    def effort(
        self, q: Motion | ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
    ) -> Array:
        """Efforts as the columns `signals.effort` of a log contain them, shape of `q`.

        In the unit of the log, such as A, mA or %: `torque` divided by the drive gains, which
        contain estimated `effort_scales`, and with efforts of motors on their side of the gears. Of
        a robot whose log has joint torques and no such scales it is equal to `torque`. A drive that
        controls the logged effort needs these as feedforward.

        Args:
            q: Positions; or a `Motion`, which has all three.
            dq: Velocities.
            ddq: Accelerations.

        Example:
            >>> model = load_model("arm-model")
            >>> still = [0.0, 0.0]
            >>> efforts = model.effort([0.3, 0.5], still, still)
            >>> model.effort_scales is None
            True
            >>> bool((efforts == model.torque([0.3, 0.5], still, still)).all())
            True
        """
        return self.signals.logged_efforts(self._along(TORQUE, q, dq, ddq))

    def start(self) -> Stepper:
        """Begin to evaluate sample by sample: `start().step(q, dq, ddq)`."""
        return self.valued.start()

    def mass_and_centre(self, q: ArrayLike) -> MassAndCentre:
        """Mass and centre of mass of the whole robot, with 95 % intervals, of a floating base.

        Args:
            q: Positions of the joints, or of all coordinates; one or many.

        Raises:
            ModelError: The base is fixed, or an unknown wrench acts on it.

        Example:
            >>> model = load_model("arm-model")
            >>> model.mass_and_centre([0.3, 0.5]) if model.robot.floating else "fixed base"
            'fixed base'
        """
        return mass_and_centre(self, q)

    @cached_property
    def base_covariance(self) -> Array:
        """Covariance of all base parameters, shape `(b, b)`.

        Without prior it is zero for parameters that the data do not identify.
        """
        estimate, base = self.estimate, self.base
        if estimate.standard is not None:
            return np.asarray(base.lift @ estimate.standard.covariance @ base.lift.T)
        return estimate.covariance_of(base.base_names)

    def residual_std(self, bandwidth: float) -> Array:
        """Standard deviation of residuals behind a low-pass, shape `(n,)` [Nm; N].

        It is NaN for a joint without samples.

        Args:
            bandwidth: Of the low-pass, for white noise; one below that of the fit is not credited,
                for what a model lacks is slow [Hz].
        """
        ratio = max(1.0, bandwidth / noise_bandwidth(self.cutoffs.matched))
        known = self.estimate.n_samples > 0.0
        return np.asarray(np.where(known, self.estimate.sigma, np.nan) * np.sqrt(ratio))

    def observe(
        self,
        frame: str | None = None,
        *,
        bandwidth: float | None = None,
        force: float = FORCE,
        lever: float = LEVER,
        axes: Axes = "frame",
        thresholds: ContactThresholds | None = None,
    ) -> Observer:
        """Begin to observe external efforts and a wrench, sample by sample.

        Args:
            frame: Frame that the wrench acts on; that of the robot's end if `None`.
            bandwidth: Of the observer [Hz]; if `None`, the cut-off of the model's scores.
            force: Expected size of each component of the force [N].
            lever: That of the moment, over `force` [m]; 0 for forces at the frame's origin.
            axes: Whose axes the wrench is given along.
            thresholds: Of contact, for `Observer.contact`; the bandwidth is then theirs.

        Raises:
            ModelError: There is no such frame, or no joint moves it.
            DataError: The bandwidth or the force is not above zero, or not that of the thresholds.

        Example:
            >>> observer = load_model("arm-model").observe("lower", bandwidth=5.0)
            >>> observer.step(0.0, [0.3, 0.5], [0.0, 0.0], [0.0, 0.0])
            >>> observer.wrench.shape
            (6,)
        """
        refuse_floating(self.robot, "an observer of efforts")
        usual = self.cutoffs.score if thresholds is None else thresholds.cutoff
        bandwidth = usual if bandwidth is None else bandwidth
        check_bandwidth(bandwidth)
        if thresholds is not None and bandwidth != usual:
            wrong = f"thresholds for {usual:g} Hz do not fit a bandwidth of {bandwidth:g} Hz"
            fix = "leave the bandwidth out"
            raise DataError(wrong, where="observe()", fix=fix)
        return Observer(self, frame, axes, bandwidth, Expected(force, lever), thresholds)

    def effort_uncertainty(self, bandwidth: float) -> EffortUncertainty:
        """How far predicted efforts may be off.

        Args:
            bandwidth: Of the low-pass that they are compared behind, for white noise [Hz].
        """
        sigma = self.residual_std(bandwidth)
        known = sigma[np.isfinite(sigma)]
        largest = float(known.max()) if len(known) else 1.0
        sigma = np.where(np.isfinite(sigma), sigma, UNKNOWN * largest)
        return EffortUncertainty(
            covariance_root(self.base_covariance),
            np.maximum(sigma, LEAST_RESIDUAL_STD * max(largest, LEAST_RESIDUAL_STD)),
            dead_zone(self.valued),
            self.calibration,
        )

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "model": self.model.to_dict(),
            "base": self.base.to_dict(),
            "estimate": self.estimate.to_dict(),
            "reference": [estimate.to_dict() for estimate in self.reference],
            "signals": json_values(self.signals),
            "cutoffs_hz": vars(self.cutoffs),
            "processing": self.processing.to_dict(),
            "motions": [samples.to_dict() for samples in self.motions],
            "calibration": None if self.calibration is None else self.calibration.to_dict(),
            "effort_scales": None if self.effort_scales is None else self.effort_scales.to_dict(),
            "provenance": json_values(self.provenance),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "IdentifiedModel":
        """The identified model that `to_dict` wrote."""
        model, calibrated = Model.from_dict(data["model"]), data.get("calibration")
        if (scales := data.get("effort_scales")) is not None:
            scales = of_json_values(KnownScales, {**scales, "joints": model.robot.joint_names})
        return cls(
            model=model,
            base=BaseMap.from_dict(data["base"]),
            estimate=Estimate.from_dict(data["estimate"]),
            reference=tuple(Estimate.from_dict(e) for e in data["reference"]),
            signals=signals_from_dict(data["signals"]),
            cutoffs=of_json_values(Cutoffs, data["cutoffs_hz"]),
            processing=Processing.from_dict(data["processing"]),
            motions=tuple(MotionSamples.from_dict(m) for m in data.get("motions", ())),
            provenance=of_json_values(Provenance, data["provenance"]),
            calibration=None if calibrated is None else Calibration.from_dict(calibrated),
            effort_scales=scales,
        )

    def text(self) -> str:
        """The content of `model.json`."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    def save(self, folder: str | Path) -> Path:
        """Make a folder with `model.json`, which `load_model` and the command line read.

        Args:
            folder: Where; it must not exist yet, or be empty.

        Returns:
            The folder.

        Raises:
            OutputError: It is there and not empty, or cannot be written.

        Example:
            >>> folder = load_model("arm-model").save("arm-copy")
            >>> load_model(folder).joints == load_model("arm-model").joints
            True
        """
        with whole_folder(Path(folder)) as part:
            (part / "model.json").write_text(self.text(), encoding="utf-8")
        return Path(folder)


@checked()
def load_model(path: str | Path | IdentifiedModel) -> IdentifiedModel:
    """Read `model.json`, or the folder that contains it; a model is returned as it is.

    Raises:
        ModelError: It is missing, not an identified model, or of another version.

    Example:
        >>> print(str(load_model("arm-model")).splitlines()[0])
        arm: joint1, joint2
    """
    if isinstance(path, IdentifiedModel):
        return path
    file = Path(path)
    if file.is_dir():
        file = file / "model.json"
    fix = "give the model.json, or the output folder, that `steelyard identify` wrote"
    if not file.exists():  # models may be meant in folders of a similar name, or within
        given = Path(path)
        beside, inside = (
            sorted(one.parent for one in folder.glob("*/model.json"))
            for folder in (given.parent, given)
        )
        similar = nearest(given.name, (folder.name for folder in beside))
        meant = [given.parent / name for name in similar] or inside
        fix = f"did you mean {' or '.join(map(str, meant[:3]))}?" if meant else fix
    elif file.suffix == ".toml":
        wrong = "the file is a robot file, not an identified model"
        raise ModelError(wrong, where=str(file), fix=fix)

    def parse(data: Any) -> IdentifiedModel:
        if isinstance(data, dict) and data.get("schema") == OF_ACTUATORS:
            raise ModelError(
                "the model is one of actuators that follow position targets, without efforts",
                where=str(file),
                fix="`steelyard validate` reads it; for all else identify from logs with efforts",
            )
        if not isinstance(data, dict) or data.get("schema") != SCHEMA:
            raise ModelError("the file is not an identified model", where=str(file), fix=fix)
        if data.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(
                f"the model has schema version {data.get('schema_version')}, not {SCHEMA_VERSION}",
                where=str(file),
                fix="identify again with this version of steelyard",
            )
        return IdentifiedModel.from_dict(data)

    damaged = "the model is incomplete or damaged"
    return read_json(file, parse, what="the model", damaged=damaged, fix=fix)


def far_beyond_limits(robot: Robot, q: Array) -> str:
    """That an angle is beyond two turns and twice the limits of its joint; empty if none is."""
    farthest = np.abs(q.reshape(-1, robot.n)).max(axis=0, initial=0.0)
    for joint, angle in zip(robot.coordinates, farthest, strict=True):
        widest = max(abs(joint.limits.lower), abs(joint.limits.upper))
        if joint.unit == "rad" and angle > max(4.0 * pi, 2.0 * widest):
            return (
                f"position {angle:.4g} of joint '{joint.name}' is far beyond its limits "
                f"({joint.limits.lower:.3g} to {joint.limits.upper:.3g} rad)"
            )
    return ""
