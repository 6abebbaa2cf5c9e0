"""Robot files of the demo arm with other causes of torque and other signals."""

import shutil
from pathlib import Path


def edited(given: Path, folder: Path, *changes: tuple[str, str]) -> Path:
    """The demo arm's robot file in a folder, beside its URDF, with some of its text replaced."""
    shutil.copy(given / "demo_arm.urdf", folder / "demo_arm.urdf")
    text = (given / "demo_arm.toml").read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "arm.toml"
    path.write_text(text)
    return path
