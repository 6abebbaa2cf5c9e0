"""The sections of a new robot file that are comments: settings with what they mean."""

SETTINGS = """\
[processing]
# The chain from rows to motion; what is left out, the data decides. What was done is printed.
# Distance from the rows around, in usual ones, from which a value is bridged; or "keep".
# outliers = 15.0
# Rows that repeat the positions of the one before while the robot moves; or "keep".
# repeats = "bridge"
# Efforts that stay at a limit, and their surroundings; or "keep".
# saturation = "leave_out"
# Clock [Hz] that rows are brought to, and how: "cubic", "linear", "pchip" or "spline".
# rate = 100.0
# resampling = "cubic"
# From positions to motion, and the low-pass before: "butterworth", "fir", "savitzky_golay", ...;
# a table gives settings: {method = "savitzky_golay", degree = 3}.
# motion = "butterworth"
# motion_cutoff = 25.0
# Efforts stay as logged otherwise.
# effort = {method = "moving_average", span = 9}
# Low-pass of regressor and effort alike [Hz], and the speed up to which a joint rests [rad/s; m/s].
# matched_cutoff = 8.0
# rest_speed = 0.01

[prior]
# Masses, centres and inertias before the data: those of the "model", or "none".
# source = "model"
# How far they may be off, relatively; found from the data if left out.
# uncertainty = 0.3
# Links whose mass is known better, or not at all.
# [prior.links.NAME]
# mass = 3.9
# box = {size = [0.1, 0.1, 0.3], centre = [0.0, 0.0, 0.15]}
# What holds in any case: kinds are "mass", "total_mass", "centre_in_box", "parameter", ...
# [[knowledge]]
# kind = "total_mass"
# upper = 31.0

[validation]
# Low-pass through which measured and predicted effort are compared [Hz].
# cutoff = 8.0"""
