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

from steelyard.base.errors import SteelyardError as SteelyardError

if TYPE_CHECKING:
    from steelyard import terms as terms
    from steelyard.base.motion import Motion as Motion
    from steelyard.base.motion import Trajectory as Trajectory
    from steelyard.check.check import check as check
    from steelyard.estimate.estimate import Estimate as Estimate
    from steelyard.estimate.estimators import estimators as estimators
    from steelyard.estimate.identified import IdentifiedModel as IdentifiedModel
    from steelyard.estimate.identified import load_model as load_model
    from steelyard.estimate.information.base_parameters import base_parameters as base_parameters
    from steelyard.estimate.information.information import Information as Information
    from steelyard.estimate.nonlinear.fields import information as information
    from steelyard.excite.excite import design_excitation as design_excitation
    from steelyard.excite.reduction_loop import reduction_loop as reduction_loop
    from steelyard.excite.trajectories.trajectory_files import read_trajectory as read_trajectory
    from steelyard.export.code.model_code import export_code as export_code
    from steelyard.export.model_files.model_file import export as export
    from steelyard.identify.comparison.compare import compare as compare
    from steelyard.identify.comparison.compare_models import compare_models as compare_models
    from steelyard.identify.identify import Identification as Identification
    from steelyard.identify.identify import identify as identify
    from steelyard.identify.reduce import reduce as reduce
    from steelyard.identify.refits import repeated as repeated
    from steelyard.identify.residuals import residuals as residuals
    from steelyard.identify.scores import parameter_table as parameter_table
    from steelyard.identify.validate import validate as validate
    from steelyard.logs.formats import open_log as open_log
    from steelyard.model.dynamics import Dynamics as Dynamics
    from steelyard.model.evaluation import Stepper as Stepper
    from steelyard.model.model import Model as Model
    from steelyard.model.robot_file_model import model_of as model_of
    from steelyard.robot.file.loaded_robot import LoadedRobot as LoadedRobot
    from steelyard.robot.file.robot_file import load_robot as load_robot
    from steelyard.robot.robot import Robot as Robot
    from steelyard.runs.named_logs import load_runs as load_runs
    from steelyard.runs.run import Run as Run
    from steelyard.runs.smoothing.kalman_filter import KalmanFilter as KalmanFilter
    from steelyard.simulate.simulate import simulate as simulate
    from steelyard.simulate.track import track as track
    from steelyard.uses.contact.contact import contact as contact
    from steelyard.uses.control.feedforward_torques import feedforward as feedforward
    from steelyard.uses.health.health import health as health
    from steelyard.uses.payload.payload import identify_payload as identify_payload
    from steelyard.uses.payload.payload import payload_events as payload_events
    from steelyard.uses.wrench.external_wrench import external_wrench as external_wrench

    __version__: str

_HOMES = {
    "Dynamics": "model.dynamics",
    "Estimate": "estimate.estimate",
    "Identification": "identify.identify",
    "IdentifiedModel": "estimate.identified",
    "Information": "estimate.information.information",
    "KalmanFilter": "runs.smoothing.kalman_filter",
    "LoadedRobot": "robot.file.loaded_robot",
    "Model": "model.model",
    "Motion": "base.motion",
    "Robot": "robot.robot",
    "Run": "runs.run",
    "Stepper": "model.evaluation",
    "Trajectory": "base.motion",
    "base_parameters": "estimate.information.base_parameters",
    "check": "check.check",
    "compare": "identify.comparison.compare",
    "compare_models": "identify.comparison.compare_models",
    "contact": "uses.contact.contact",
    "design_excitation": "excite.excite",
    "estimators": "estimate.estimators",
    "export": "export.model_files.model_file",
    "export_code": "export.code.model_code",
    "external_wrench": "uses.wrench.external_wrench",
    "feedforward": "uses.control.feedforward_torques",
    "health": "uses.health.health",
    "identify": "identify.identify",
    "identify_payload": "uses.payload.payload",
    "information": "estimate.nonlinear.fields",
    "load_model": "estimate.identified",
    "load_robot": "robot.file.robot_file",
    "load_runs": "runs.named_logs",
    "model_of": "model.robot_file_model",
    "open_log": "logs.formats",
    "parameter_table": "identify.scores",
    "payload_events": "uses.payload.payload",
    "read_trajectory": "excite.trajectories.trajectory_files",
    "reduce": "identify.reduce",
    "reduction_loop": "excite.reduction_loop",
    "repeated": "identify.refits",
    "residuals": "identify.residuals",
    "simulate": "simulate.simulate",
    "terms": "",
    "track": "simulate.track",
    "validate": "identify.validate",
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
