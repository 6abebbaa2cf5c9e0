"""Options that several commands share."""

from typing import Annotated, Any

import typer

Json = Annotated[bool, typer.Option("--json", help="Machine-readable results on standard output.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Print what each check found, ok ones too.")
]
Details = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Print all errors, parameters and notes."),
]
DesignDetails = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        help="Print all tight limits, all motions that would reduce uncertainty, and notes.",
    ),
]
Threads = Annotated[
    int | None, typer.Option(min=1, help="Threads for the pass over the data; all cores if unset.")
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")]
FrictionDrift = Annotated[
    float,
    typer.Option(
        min=0, max=1000, metavar="FACTOR", help="Factor on the true friction, such as 1.2."
    ),
]


def output_folder(default: str) -> Any:
    """The option of a folder that is always written, `default` if unset."""
    return typer.Option(
        "--output",
        "-o",
        help=f"Output folder; must not exist. If unset {default}, or {default}-2 and so on if "
        "that exists.",
    )


Commanded = Annotated[
    bool,
    typer.Option(
        "--commanded",
        help="Predict the efforts of validation logs from the commanded motion "
        "(commanded_position in the robot file), as feedforward would.",
    ),
]
ARGUMENTS = "Arguments of a xacro file follow it: arm.urdf.xacro name:=left."
RobotArgument = Annotated[
    str,
    typer.Argument(
        help=f"Robot file (TOML), URDF, xacro file or MJCF. {ARGUMENTS}", metavar="ROBOT"
    ),
]
ModelArgument = Annotated[
    str, typer.Argument(help="model.json, or the folder that contains it.", metavar="MODEL")
]
AlarmRate = Annotated[
    float | None,
    typer.Option(
        min=1e-9,
        help="False alarms per hour of all joints together; if unset 1, or as few as the "
        "calibration supports.",
        metavar="NUMBER",
    ),
]
FixedBase = Annotated[
    str | None,
    typer.Option(
        help="Link to fix to the world, for a URDF or MJCF with a floating base; in a robot "
        "file, base = ... does this.",
        metavar="LINK",
    ),
]
LOG_HELP = (
    "Logs: CSV, Parquet (a file, or a folder of parts), MCAP, ROS 1 and 2 bags, NumPy, MATLAB, "
    "HDF5. Cut by time: run.parquet@0.6:9.5 (seconds from its start), "
    "or by rows: run.parquet#921:4442."
)
