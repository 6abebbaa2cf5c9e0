"""steelyard: identify a robot's dynamics from its motion and its torque.

A robot file and logs in, a model with its uncertainty out:

    import steelyard

    found = steelyard.identify("ur10e.toml", ["run1.csv", "run2.csv"], validate="run3.csv")
    print(found)
    found.save("ur10e-model")
    torque = found.model.torque(steelyard.Motion(t, q, dq, ddq))

`dir(steelyard)` lists all names; each has an example in its docstring.
"""

from typing import TYPE_CHECKING, Any

from steelyard.errors import SteelyardError as SteelyardError

if TYPE_CHECKING:
    from steelyard import terms as terms
    from steelyard.application.controller.export import export_code as export_code
    from steelyard.application.export.export import export as export
    from steelyard.dynamics.dynamics import Dynamics as Dynamics
    from steelyard.dynamics.stepper import Stepper as Stepper
    from steelyard.estimation.estimate import Estimate as Estimate
    from steelyard.estimation.fields.fields import information as information
    from steelyard.estimation.identified import IdentifiedModel as IdentifiedModel
    from steelyard.estimation.identified import load_model as load_model
    from steelyard.estimation.register import estimators as estimators
    from steelyard.excitation.trajectories.files import read_trajectory as read_trajectory
    from steelyard.formats.register import open_log as open_log
    from steelyard.identification.checks.check import check as check
    from steelyard.identification.comparison.compare import compare as compare
    from steelyard.identification.comparison.compare_models import compare_models as compare_models
    from steelyard.identification.described_model import model_of as model_of
    from steelyard.identification.fitting.repeated import repeated as repeated
    from steelyard.identification.identify import Identification as Identification
    from steelyard.identification.identify import identify as identify
    from steelyard.identification.motion.design import design_excitation as design_excitation
    from steelyard.identification.motion.simulate import simulate as simulate
    from steelyard.identification.motion.track import track as track
    from steelyard.identification.named_logs import load_runs as load_runs
    from steelyard.identification.reduction.reduce import reduce as reduce
    from steelyard.identification.reduction.reduction_loop import reduction_loop as reduction_loop
    from steelyard.identification.result import parameter_table as parameter_table
    from steelyard.identification.uses.contact import contact as contact
    from steelyard.identification.uses.feedforward import feedforward as feedforward
    from steelyard.identification.uses.health import health as health
    from steelyard.identification.uses.payload import identify_payload as identify_payload
    from steelyard.identification.uses.payload import payload_events as payload_events
    from steelyard.identification.uses.residuals import residuals as residuals
    from steelyard.identification.uses.wrench import external_wrench as external_wrench
    from steelyard.identification.validate import validate as validate
    from steelyard.measurement.kalman_filter import KalmanFilter as KalmanFilter
    from steelyard.measurement.run import Run as Run
    from steelyard.model import Model as Model
    from steelyard.motion import Motion as Motion
    from steelyard.motion import Trajectory as Trajectory
    from steelyard.regression.base import base_parameters as base_parameters
    from steelyard.regression.information import Information as Information
    from steelyard.robot.robot import Robot as Robot
    from steelyard.robot_file.file import load_robot as load_robot
    from steelyard.robot_file.loaded import LoadedRobot as LoadedRobot

    __version__: str

_HOMES = {
    "Dynamics": "dynamics.dynamics",
    "Estimate": "estimation.estimate",
    "Identification": "identification.identify",
    "IdentifiedModel": "estimation.identified",
    "Information": "regression.information",
    "KalmanFilter": "measurement.kalman_filter",
    "LoadedRobot": "robot_file.loaded",
    "Model": "model",
    "Motion": "motion",
    "Robot": "robot.robot",
    "Run": "measurement.run",
    "Stepper": "dynamics.stepper",
    "Trajectory": "motion",
    "base_parameters": "regression.base",
    "check": "identification.checks.check",
    "compare": "identification.comparison.compare",
    "compare_models": "identification.comparison.compare_models",
    "contact": "identification.uses.contact",
    "design_excitation": "identification.motion.design",
    "estimators": "estimation.register",
    "export": "application.export.export",
    "export_code": "application.controller.export",
    "external_wrench": "identification.uses.wrench",
    "feedforward": "identification.uses.feedforward",
    "health": "identification.uses.health",
    "identify": "identification.identify",
    "identify_payload": "identification.uses.payload",
    "information": "estimation.fields.fields",
    "load_model": "estimation.identified",
    "load_robot": "robot_file.file",
    "load_runs": "identification.named_logs",
    "model_of": "identification.described_model",
    "open_log": "formats.register",
    "parameter_table": "identification.result",
    "payload_events": "identification.uses.payload",
    "read_trajectory": "excitation.trajectories.files",
    "reduce": "identification.reduction.reduce",
    "reduction_loop": "identification.reduction.reduction_loop",
    "repeated": "identification.fitting.repeated",
    "residuals": "identification.uses.residuals",
    "simulate": "identification.motion.simulate",
    "terms": "",
    "track": "identification.motion.track",
    "validate": "identification.validate",
}
"""Where names live: a module, and behind a colon the name there if it is another one."""

__all__ = ["SteelyardError", *_HOMES]


def __getattr__(name: str) -> Any:
    """Load what is heavier only on first use: the command line starts at once."""
    import importlib

    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("steelyard")
    if name not in _HOMES:
        raise AttributeError(f"module 'steelyard' has no attribute '{name}'")
    module, _, attribute = _HOMES[name].partition(":")
    if not module:
        return importlib.import_module(f"steelyard.{name}")
    return getattr(importlib.import_module(f"steelyard.{module}"), attribute or name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
