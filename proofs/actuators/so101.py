"""An SO-101 arm of six servos: whole unseen motions, predicted from their targets alone.

Zero code: `init` writes the robot file, `identify` fits eight motions, `validate` predicts the
other 27, from target alone and from the first row to the last. In some of them the arm touches the
table, and those count too; the motion of a wrist into its stop is among those fitted. "position =
target" has errors of 16 to 60 mrad.
"""

import tempfile
from pathlib import Path

import numpy as np
from proofs.checks.two_faults import run
from proofs.support.claims import Claim, data_folder, main_of

import steelyard

FITTED = (
    *("friction_gravity", "reaching_points", "workspace_sweep", "multisine", "end_effector"),
    *("inertia_coupling", "chirp_sweep", "single_joint_wrist_roll"),
)
BOUNDS = (3.0, 7.0, 9.0, 8.0, 4.0)
"""Of the mean over the motions of the error of joints 1 to 5 [mrad]."""
MEAN = 5.5
"""Of the mean over all joints [mrad]."""


def main() -> list[Claim]:
    """The errors."""
    data = data_folder() / "so101"
    model = data.parent.parent / "models" / "so101" / "so101_new_calib.urdf"
    fitted = [data / f"{name}.parquet" for name in FITTED]
    unseen = [path for path in sorted(data.glob("*.parquet")) if path not in fitted]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "so101.toml"
        run("init", model, fitted[0], "-o", file)
        found = steelyard.identify_actuators(file, fitted)
    scored = steelyard.validate_actuators(found.model, unseen)
    errors = 1e3 * np.array([one.rms for one in scored.validation])
    mean, middle = errors.mean(axis=0), np.median(errors, axis=0)
    claims = [
        Claim(
            f"SO-101, {len(unseen)} unseen motions, joint {j + 1} ({joint})",
            f"{mean[j]:.1f} mrad, median {middle[j]:.1f}",
            f"<= {BOUNDS[j]:g} mrad" if j < len(BOUNDS) else "reported",
            j >= len(BOUNDS) or bool(mean[j] <= BOUNDS[j]),
        )
        for j, joint in enumerate(found.model.joints)
    ]
    value = f"{errors.mean():.2f} mrad, median {np.median(errors):.2f}"
    good = bool(errors.mean() <= MEAN)
    return [Claim("SO-101, mean of all joints", value, f"<= {MEAN:g} mrad", good), *claims]


if __name__ == "__main__":
    main_of(main)
