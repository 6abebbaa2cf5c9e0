"""A measured robot whose efforts fall with speed: the bounds of its model do not hold.

Efforts of the last three axes of naruton6 fall with speed, as if friction drove them. `identify`
calls the model poor, and names the joints whose bounds the log contradicts.
"""

import tempfile
from pathlib import Path

from proofs.support.claims import Claim, data_folder, main_of

import steelyard

ROBOT = """
[robot]
urdf = "{folder}/naruton6.urdf"

[model]
terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]

[signals]
time = "time_s"
position = "q{{}}_rad"
velocity = "dq{{}}_rad_s"

[signals.effort]  # counts to Nm of the set's main.m
columns = "torque{{}}_raw"
kind = "motor_current"
unit = "A"
gain = [0.034768, 0.034768, -0.034768, 0.013562, 0.013562, 0.013562]
"""
USELESS, CONTRADICTED = ("joint4", "joint5", "joint6"), {"joint5", "joint6"}


def main() -> list[Claim]:
    """Fit one log, predict the other."""
    folder = data_folder() / "naruton6"
    with tempfile.TemporaryDirectory() as place:
        robot = Path(place) / "naruton6.toml"
        robot.write_text(ROBOT.format(folder=folder))
        logs = [folder / f"naruton6_traj{k}.parquet" for k in (1, 2)]
        found = steelyard.identify(robot, logs[0], logs[1], check=False, threads=1)
        limits = found.to_dict()["limitations"]
    level, line = found.verdict.level, found.verdict.line
    zero = "no better than predicting zero at 3 of 6 joints"
    named = zero in line and all(joint in line for joint in USELESS)
    (joints,) = [set(one["joints"]) for one in limits if one["check"] == "constraints"]
    said = joints >= CONTRADICTED and "the log contradicts bounds at" in str(found)
    return [
        Claim("verdict of the model", level, "poor", level == "poor"),
        Claim("joints that zero predicts as well", line, f"{zero}: {', '.join(USELESS)}", named),
        Claim(
            "joints whose bounds the log contradicts",
            ", ".join(sorted(joints)),
            f"at least {', '.join(sorted(CONTRADICTED))}, in the text too",
            said,
        ),
    ]


if __name__ == "__main__":
    main_of(main)
