"""The sections of a new robot file that are comments: settings with what they mean."""

from collections.abc import Sequence

import numpy as np

from steelyard.robot.robot import Coordinate
from steelyard.robot_file.template.text import comment, toml_text

SETTINGS = """\
[processing]
# The chain from rows to motion. Lines below a comment show the defaults.
# Hampel threshold in scaled MAD, above which a value is interpolated; or "keep".
# outliers = 15.0
# Rows that repeat the previous positions while the robot moves: "bridge" interpolates, "keep" uses
# them.
# repeats = "bridge"
# Saturated efforts, with the rows around them: "leave_out" excludes, "keep" uses them.
# saturation = "leave_out"
# Resampling to a uniform clock: "cubic", "linear", "pchip" or "spline".
# resampling = "cubic"
# From positions to motion: "auto", "butterworth", "fir", "savitzky_golay", ...; a table gives
# settings: {method = "savitzky_golay", degree = 3}.
# motion = "auto"
# These keys have no fixed default: left out, they are chosen from the data, and `identify` prints
# the choice: rate [Hz] of the uniform clock; motion_cutoff [Hz], low-pass of positions and
# velocities; matched_cutoff [Hz], low-pass of regressor and effort alike; rest_speed [rad/s; m/s],
# up to which a joint rests. Efforts are used as logged unless the key effort is set, such
# as effort = {method = "moving_average", span = 9, passes = 2}.

[prior]
# Prior masses, centres and inertias: those of the "model", or "none". The key uncertainty
# (such as 0.3) sets their relative uncertainty; left out, it is estimated from the data.
# source = "model"
# Example of a prior of a single link, and of a constraint; kinds are "mass", "total_mass",
# "centre_in_box", "parameter", ...
# [prior.links.NAME]
# mass = 3.9
# box = {size = [0.1, 0.1, 0.3], centre = [0.0, 0.0, 0.15]}
# [[knowledge]]
# kind = "total_mass"
# upper = 31.0

[validation]
# Low-pass of measured and predicted effort [Hz]; if left out, 5.0 for the headline and
# matched_cutoff for the other errors.
# cutoff = 5.0"""


def excitation_part(moving: Sequence[Coordinate]) -> str:
    """Limits of motions that `steelyard excite` designs: those of the model."""
    lines = [
        "[excitation.limits]",
        "# Motions of `steelyard excite`: the share of all limits that they may use.",
        "share = 0.95",
    ]
    for name, unit in (("velocity", "rad/s; m/s"), ("effort", "Nm; N")):
        limits = [getattr(c.limits, name) for c in moving]
        missing = [c.name for c, x in zip(moving, limits, strict=True) if not np.isfinite(x)]
        known = "; those of the model above, if left out."
        if missing:
            known = (
                f"; the model has none for {', '.join(missing)}: state them, or defaults are used."
            )
        lines.append(comment(f"Greatest {name} [{unit}], by joint or a list{known}"))
        values = [x if np.isfinite(x) else 1.0 for x in limits]
        lines.append(f"# {name} = {toml_text(values)}")
    lines += [
        "# Greatest acceleration [rad/s²; m/s²]; models have none: 5 rad/s² (1 m/s²) if left out.",
        f"# acceleration = {toml_text([1.0 if c.kind == 'prismatic' else 5.0 for c in moving])}",
        "# Floor [m above the origin of the base]; planes that bound the space of the robot;",
        "# keep_out: boxes that it must not enter; box: one that the tool's sphere must not leave.",
        "# [excitation.workspace]",
        "# floor = 0.0",
    ]
    return "\n".join(lines)
