"""A stream of a real UR10e: false alarms on other days, pushes by hand.

Logs are read as `steelyard watch` reads a growing file: sample by sample, without smoothing.
Thresholds are the model's own, or calibrated on every other log of unseen motion as a stream.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from proofs.robots.scores import identified, ur10e_logs
from proofs.support.claims import Claim, data_folder, main_of
from proofs.uses.contact_ur10e import RATE, UNSEEN
from scipy.stats import poisson

import steelyard
from steelyard.application.payload_events import PayloadEvent
from steelyard.application.watch.contact_stream import ContactStart
from steelyard.application.watch.watcher import StreamEvent, Watcher
from steelyard.arrays import Array
from steelyard.estimation.identified import IdentifiedModel
from steelyard.identification.uses.watch import start_watch

PUSHES = "collision/ur-20_01_22-push_pose_1"


def rows_of(model: IdentifiedModel, path: str) -> Array:
    """All rows of a log, shape `(N, columns)`."""
    return np.concatenate(list(steelyard.open_log(path).parts(model.signals.columns)))


def watched(model: IdentifiedModel, rows: Array) -> tuple[list[StreamEvent], float]:
    """All that a stream with the model's own thresholds reports, and its length [s]."""
    watcher = start_watch(model, rate=RATE).watcher
    return [*watcher.take(rows), *watcher.end()], watcher.time


def contacts(
    model: IdentifiedModel, logs: Sequence[str], calibrate: Sequence[str]
) -> tuple[int, float]:
    """Contacts in streams with thresholds of calibration logs, and minutes."""
    thresholds = start_watch(model, calibrate=calibrate, rate=RATE).watcher.thresholds
    assert thresholds is not None
    count, minutes = 0, 0.0
    for log in logs:
        watcher = Watcher(model, model.observe(bandwidth=thresholds.cutoff), None, thresholds)
        found = [*watcher.take(rows_of(model, log)), *watcher.end()]
        count += sum(isinstance(one, ContactStart) for one in found)
        minutes += watcher.time / 60.0
    return count, minutes


def _log(name: str) -> str:
    return str(data_folder() / "ur10e" / f"{name}.parquet")


def _unseen(model: IdentifiedModel) -> list[Claim]:
    """Contacts and payloads that are not there."""
    logs = [_log(name) for name in UNSEEN]
    found = [watched(model, rows_of(model, log)) for log in logs]
    own = sum(isinstance(one, ContactStart) for some, _ in found for one in some)
    changes = sum(isinstance(one, PayloadEvent) for some, _ in found for one in some)
    minutes = sum(seconds for _, seconds in found) / 60.0
    halves = logs[::2], logs[1::2]
    both = [contacts(model, *pair) for pair in (halves, halves[::-1])]
    count, length = (sum(values) for values in zip(*both, strict=True))
    most = int(poisson.ppf(0.99, length / 60.0 * RATE))
    pushes = [contacts(model, [_log(PUSHES)], some)[0] for some in ([], logs)]
    return [
        Claim(
            "false alarms, thresholds of smoothed logs for one in 10 min",
            f"{own} in {minutes:.1f} min",
            f"<= {most}, 99 % of Poisson's law",
            own <= most,
        ),
        Claim(
            "false alarms, thresholds of the other half as a stream for one in 10 min",
            f"{count} in {length:.1f} min",
            f"<= {most}, 99 % of Poisson's law",
            count <= most,
        ),
        Claim("false changes of the payload there", f"{changes}", "0", changes == 0),
        Claim(
            "pushes found with thresholds of smoothed logs, and of streams",
            f"{pushes[0]} and {pushes[1]} of 4",
            ">= 3 each",
            min(pushes) >= 3,
        ),
    ]


def main() -> list[Claim]:
    """All of the UR10e; about three minutes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        identified("ur10e", ur10e_logs(), [], output=folder / "model")
        model = steelyard.load_model(folder / "model")
        return _unseen(model)


if __name__ == "__main__":
    main_of(main)
