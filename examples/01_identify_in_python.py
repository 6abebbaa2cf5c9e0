"""Identification step by step in Python: from logs to base parameters and a score on an unseen run.

Run it with a folder for the simulated logs: python examples/01_identify_in_python.py /tmp/identify
"""

import sys
from pathlib import Path

from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.scores.score import score
from steelyard.logs.formats import open_log
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import Recording
from steelyard.simulate.simulate import demo_runs

files = demo_runs(Path(sys.argv[1]))
robot = load_robot(files.robot)
assert robot.signals is not None
fitted, unseen = (
    prepare(Recording(open_log(path), robot.signals))
    for path in (files.identification, files.validation)
)
regressor = base_regressor(Model(robot.robot))
information = gather(regressor, fitted).scaled(robot.signals.gains, robot.robot.effort_units)
estimate = WeightedLeastSquares()(information)
model = regressor.model.at(estimate.parameters)

for name, unit, value, half in zip(
    estimate.parameters.names,
    estimate.parameters.units,
    estimate.parameters.values,
    estimate.half_width,
    strict=True,
):
    print(f"{name:<28} {value:>10.4f} ± {half:.4f} {unit}")
result = score(model, unseen, robot.signals.gains, cutoff=unseen.matched_cutoff)
print(f"unseen run predicted within {result.mean_percent_moving:.2f} %")
