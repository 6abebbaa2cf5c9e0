"""The TX40, logged on the motors' side of a differential wrist: error, coupling, minimal set.

The motor-side rotor inertia and friction of axis 6 (`IA_motor_6`, `FC_motor_6`, `FV_motor_6`) turn
with q5 + q6: a unit of each counts alike in the rows of joint 5 and of joint 6. Coulomb friction
of joint 6 itself (`FC6`) counts in row 6 alone.
"""

import sys
import tempfile
from pathlib import Path

from proofs.robots.scores import EXAMPLES, identified
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import symbols

CUSTOMARY = ("ZZ1R", "XX2R", "ZZ2R", "MX2R", "MY3R", "XX3R", "ZZ3R")


def log(window: str) -> str:
    """The one run, cut."""
    return f"{data_folder() / 'tx40' / 'tx40_run1.parquet'}@{window}"


def without_coupling(folder: Path) -> Path:
    """The shipped robot file without the terms of motor 6."""
    text = (EXAMPLES / "tx40.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("  {law")]
    file = folder / "tx40.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


def minimal_set(model: IdentifiedModel) -> str:
    """Every parameter with its interval and its group, under its customary symbol."""
    names, estimate = model.base.base_names, model.estimate
    known = {
        name: (value, half, unit)
        for name, value, half, unit in zip(
            estimate.parameters.names,
            estimate.parameters.values,
            estimate.half_width,
            estimate.parameters.units,
            strict=True,
        )
    }
    lines = []
    for number, symbol in enumerate(symbols(model.model.robot, model.base)):
        if names[number] not in known:
            lines.append(f"  {symbol:<12} not seen")
            continue
        value, half, unit = known[names[number]]
        group = model.base.grouping(number)
        lines.append(f"  {symbol:<12} {value:>9.4f} ± {half:<8.4f} {unit:<10} {group}")
    return "\n".join(lines)


def main() -> list[Claim]:
    """The split of the data's README, then all 7.5 s for the minimal set."""
    score = identified("tx40", [log("0.1:5.2")], [log("5.2:7.5")])["validation"][0]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        plain = identified(
            "tx40", [log("0.1:5.2")], [log("5.2:7.5")], file=without_coupling(place)
        )["validation"][0]
        identified("tx40", [log("0.1:7.5")], [], output=place / "all")
        model = load_model(place / "all")
    mean = score["mean_percent"]
    times = plain["joints"][4]["relative_percent"] / score["joints"][4]["relative_percent"]
    found = set(symbols(model.model.robot, model.base))
    print("minimal set on 0.1 to 7.5 s, 95 % intervals", file=sys.stderr)
    print(minimal_set(model), file=sys.stderr)
    inertial = sum(
        not s.startswith(("IA", "FC", "FV", "OFF")) for s in symbols(model.model.robot, model.base)
    )
    return [
        Claim("TX40, mean of the whole log", f"{mean:.1f} %", "<= 15.5 %", mean <= 15.5),
        Claim("TX40, joint 5 without coupling", f"{times:.1f} times", ">= 5 times", times >= 5.0),
        Claim(
            f"TX40, customary groupings among {inertial} of the bodies",
            ", ".join(s for s in CUSTOMARY if s in found),
            ", ".join(CUSTOMARY),
            set(CUSTOMARY) <= found,
        ),
    ]


if __name__ == "__main__":
    main_of(main)
