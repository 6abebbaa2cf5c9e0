"""Logs that contact, health and payload cannot use as they are: each ends in a clear statement.

The model is that of the real UR10e. Its logs lose gravity (a controller that compensates it), or
friction (sensors on the link side), or most samples; a Panda's log gets its columns; it carries a
load that nobody stated; it does not move; it is pushed while thresholds are calibrated.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from proofs.robots.scores import EXAMPLES, identified, ur10e_logs
from proofs.support.claims import Claim, data_folder, main_of

import steelyard
from steelyard.base.arrays import Array
from steelyard.estimate.identified_model import IdentifiedModel

UNLOADED = "ur10e/identification/ur-20_01_31-unload"
LOADED = "ur10e/identification/ur-20_01_31-load"
RESTING = "ur10e/validation/ur-20_01_17-p1"
PUSHED = "ur10e/collision/ur-20_01_22-push_pose_1"
OTHER_ROBOT = "panda/panda_gaz2019_trajectory1"
FREE = "ur10e/identification/ur-19_12_23_free"

Use = Callable[[str | Path], str]
"""What a command says of a log: its first line of an error, or its warnings and result."""


def _log(name: str) -> str:
    return str(data_folder() / f"{name}.parquet")


def _written(path: Path, t: Array, q: Array, dq: Array, current: Array) -> str:
    """A log with the columns of the UR10e's."""
    columns = {"time_s": t}
    for name, signal in (("q{}_rad", q), ("dq{}_rad_s", dq), ("current{}_A", current)):
        columns |= {name.format(k + 1): x for k, x in enumerate(signal.T)}
    np.savez(path, **columns)
    return str(path)


def _made(model: IdentifiedModel, folder: Path) -> dict[str, str]:
    """The logs by what is wrong with them."""
    (run,) = steelyard.load_runs(EXAMPLES / "ur10e.toml", _log(UNLOADED))
    data = run.whole()
    motion, gains = data.motion, model.signals.gains
    sent = (motion.t, motion.q, motion.dq)
    gravity, friction = model.gravity(motion.q) / gains, model.friction(motion) / gains
    log = steelyard.open_log(_log(OTHER_ROBOT))
    names = [f.format(k) for f in ("q{}_rad", "dq{}_rad_s", "tau{}_Nm") for k in range(1, 7)]
    parts = list(log.parts(["time_s", *names], (0, None), 1 << 20))
    t, *other = np.split(np.concatenate(parts), [1, 7, 13], axis=1)
    slow = [x[::6] for x in (*sent, data.effort)]
    return {
        "gravity-compensated": _written(folder / "g.npz", *sent, data.effort - gravity),
        "on the link side": _written(folder / "f.npz", *sent, data.effort - friction),
        "16 Hz": _written(folder / "slow.npz", *slow),
        "another robot's": _written(folder / "o.npz", t[:, 0], *other[:2], other[2] / gains),
        "no movement": _log(RESTING),
        "a load all the time": _log(LOADED),
    }


def _contact(model: IdentifiedModel) -> Use:
    def use(log: str | Path) -> str:
        content = steelyard.contact(model, log)
        return " / ".join((*content.warnings, content.headline))

    return use


def _health(model: IdentifiedModel) -> Use:
    def use(log: str | Path) -> str:
        content = steelyard.health(model, log)
        return " / ".join((*content.warnings, content.headline))

    return use


def _payload(model: IdentifiedModel) -> Use:
    def use(log: str | Path) -> str:
        found = steelyard.identify_payload(model, log)
        return f"{found.mass:.2f} ± {found.half_width[0]:.2f} kg"

    return use


def _when(model: IdentifiedModel) -> Use:
    def use(log: str | Path) -> str:
        found = steelyard.payload_events(model, log)
        carried = (f"{x.payload.mass:.2f} kg from {x.start:.0f} s" for x in found.carried)
        return f"{len(found.events)} events; carried: {', '.join(carried) or 'nothing'}"

    return use


def _said(use: Use, log: str) -> str:
    try:
        return use(log)
    except steelyard.SteelyardError as error:
        return str(error).splitlines()[0]


EXPECTED = {
    "gravity-compensated": ("100 % of the gravity",) * 4,
    "on the link side": ("100 % of the friction",) * 4,
    "16 Hz": ("cut-off of 6 Hz does not fit a log of",) * 4,
    "another robot's": ("of the squared efforts of this log",) * 4,
    "no movement": ("No contact in", *("no joint moves in this log",) * 3),
    "a load all the time": (
        "those with a payload of 2.8",
        "those with a payload of 2.8",
        "2.8",
        "0 events; carried: 2.8",
    ),
}
"""Words in what contact, health, payload and payload --when say of each log."""


def _calibration(model: IdentifiedModel, name: str, log: str, words: str) -> Claim:
    """A log beside a good one to calibrate with."""
    content = steelyard.contact(model, _log(UNLOADED), calibrate=[_log(FREE), log])
    found = next((note for note in content.notes if words in note), "nothing")
    return Claim(f"calibration of contact with {name}", found, words, words in found)


def main() -> list[Claim]:
    """Every log with every command."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        identified("ur10e", ur10e_logs(), [], output=folder / "model")
        model = steelyard.load_model(folder / "model")
        uses = {
            "contact": _contact(model),
            "health": _health(model),
            "payload": _payload(model),
            "payload --when": _when(model),
        }
        claims = []
        for kind, log in _made(model, folder).items():
            for (command, use), words in zip(uses.items(), EXPECTED[kind], strict=True):
                said = _said(use, log)
                claims.append(Claim(f"{kind}: {command}", said, words, words in said))
        calibration = (
            ("pushes", _log(PUSHED), "contains contact at"),
            ("a load", _log(LOADED), "those with a payload of 2.8"),
            ("a fitted log", ur10e_logs()[0], "was fitted"),
        )
        return [*claims, *(_calibration(model, *one) for one in calibration)]


if __name__ == "__main__":
    main_of(main)
