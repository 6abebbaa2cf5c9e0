"""The public names: read by type checkers and editors, and by `__init__.py` for where they are."""

from steelyard import terms as terms
from steelyard.actuators.actuator_model import ActuatorModel as ActuatorModel
from steelyard.actuators.actuator_model import load_actuators as load_actuators
from steelyard.actuators.check_targets import check_targets as check_targets
from steelyard.actuators.identify_actuators import identify_actuators as identify_actuators
from steelyard.actuators.identify_actuators import validate_actuators as validate_actuators
from steelyard.actuators.ranges_of_units import ranges_of_units as ranges_of_units
from steelyard.base.errors import SteelyardError as SteelyardError
from steelyard.base.motion import Motion as Motion
from steelyard.base.motion import Trajectory as Trajectory
from steelyard.check.check import check as check
from steelyard.estimate.estimate import Estimate as Estimate
from steelyard.estimate.estimator_register import estimators as estimators
from steelyard.estimate.identified_model import IdentifiedModel as IdentifiedModel
from steelyard.estimate.identified_model import load_model as load_model
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters as base_parameters,
)
from steelyard.estimate.information.information import Information as Information
from steelyard.estimate.nonlinear.nonlinear_parameters import information as information
from steelyard.excite.excite import design_excitation as design_excitation
from steelyard.excite.excite_and_reduce_loop import reduction_loop as reduction_loop
from steelyard.excite.trajectories.trajectory_files import read_trajectory as read_trajectory
from steelyard.export.code.export_code import export_code as export_code
from steelyard.export.model_files.export_model_file import export as export
from steelyard.fleet.fleet import fleet as fleet
from steelyard.fleet.fleet import plan_fleet as plan_fleet
from steelyard.fleet.informative_stretches import (
    informative_stretches as informative_stretches,
)
from steelyard.identify.comparison.compare import compare as compare
from steelyard.identify.comparison.compare import compare_models as compare_models
from steelyard.identify.identify import Identification as Identification
from steelyard.identify.identify import identify as identify
from steelyard.identify.reduce import reduce as reduce
from steelyard.identify.repeated_fits import repeated as repeated
from steelyard.identify.scores_and_model_report import parameter_table as parameter_table
from steelyard.identify.validate import residuals as residuals
from steelyard.identify.validate import validate as validate
from steelyard.logs.formats import open_log as open_log
from steelyard.model.compiled_quantity import Stepper as Stepper
from steelyard.model.dynamics import Dynamics as Dynamics
from steelyard.model.model import Model as Model
from steelyard.model.model import model_of as model_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot as LoadedRobot
from steelyard.robot.file.robot_file import load_robot as load_robot
from steelyard.robot.robot import Robot as Robot
from steelyard.runs.run import Run as Run
from steelyard.runs.runs_of_named_logs import load_runs as load_runs
from steelyard.runs.smoothing.streaming_kalman_filter import KalmanFilter as KalmanFilter
from steelyard.simulate.simulate import simulate as simulate
from steelyard.simulate.track import track as track
from steelyard.uses.contact.contact import contact as contact
from steelyard.uses.control.feedforward import feedforward as feedforward
from steelyard.uses.health.health import health as health
from steelyard.uses.payload.payload import identify_payload as identify_payload
from steelyard.uses.payload.payload import payload_events as payload_events
from steelyard.uses.wrench.wrench import external_wrench as external_wrench

__all__: list[str]
__version__: str
