"""The sections of a new robot file that are comments: settings with what they mean."""

from collections.abc import Sequence

import numpy as np

from steelyard.robot.robot import Coordinate
from steelyard.robot_file.template.text import comment, toml_text

SETTINGS = """\
[processing]
# The chain from rows to motion; defaults are chosen from the data and printed.
# Hampel threshold in scaled MAD, above which a value is interpolated; or "keep".
# outliers = 15.0
# Rows that repeat the previous positions while the robot moves; or "keep".
# repeats = "bridge"
# Saturated efforts, and the rows around them; or "keep".
# saturation = "leave_out"
# Resampling rate [Hz], and method: "cubic", "linear", "pchip" or "spline".
# rate = 100.0
# resampling = "cubic"
# From positions to motion, and the low-pass before: "butterworth", "fir", "savitzky_golay", ...;
# a table gives settings: {method = "savitzky_golay", degree = 3}.
# motion = "butterworth"
# motion_cutoff = 25.0
# Low-pass of efforts; as logged if left out.
# effort = {method = "moving_average", span = 9, passes = 2}
# Low-pass of regressor and effort alike [Hz], and the speed up to which a joint rests [rad/s; m/s].
# matched_cutoff = 8.0
# rest_speed = 0.01

[prior]
# Prior masses, centres and inertias: those of the "model", or "none".
# source = "model"
# Their relative uncertainty; estimated from the data if left out.
# uncertainty = 0.3
# Priors of single links.
# [prior.links.NAME]
# mass = 3.9
# box = {size = [0.1, 0.1, 0.3], centre = [0.0, 0.0, 0.15]}
# Prior constraints; kinds are "mass", "total_mass", "centre_in_box", "parameter", ...
# [[knowledge]]
# kind = "total_mass"
# upper = 31.0

[validation]
# Low-pass through which measured and predicted effort are compared [Hz].
# cutoff = 8.0"""


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
        "# Floor [m above the origin of the base], boxes and planes that the robot must not leave.",
        "# [excitation.workspace]",
        "# floor = 0.0",
    ]
    return "\n".join(lines)
