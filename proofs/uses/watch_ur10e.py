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
from proofs.uses.contact_ur10e import RATE, UNSEEN, pushes_in

import steelyard
from steelyard.base.arrays import Array
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.uses.contact.contact import ContactEvent
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvent
from steelyard.uses.watch.watch import start_watch
from steelyard.uses.watch.watcher_and_events import StreamEvent, Watcher

PUSHES = "collision/ur-20_01_22-push_pose_1"


def rows_of(model: IdentifiedModel, path: str) -> Array:
    """All rows of a log, shape `(N, columns)`."""
    return np.concatenate(list(steelyard.open_log(path).parts(model.signals.columns)))


def watched(model: IdentifiedModel, log: str) -> tuple[list[StreamEvent], float]:
    """All that a stream with the model's own thresholds reports, and its length [s]."""
    watcher = start_watch(model, rate=RATE).watcher
    return [*watcher.take(rows_of(model, log)), *watcher.end()], watcher.time


def thresholds_of(model: IdentifiedModel, calibrate: Sequence[str] = ()) -> ContactThresholds:
    """Thresholds of calibration logs as streams; the model's own without any."""
    thresholds = start_watch(model, calibrate=calibrate, rate=RATE).watcher.thresholds
    assert thresholds is not None
    return thresholds


def contacts(
    model: IdentifiedModel, log: str, thresholds: ContactThresholds
) -> tuple[list[ContactEvent], float]:
    """Contacts in a stream, and its length [s]."""
    watcher = Watcher(model, model.observe(bandwidth=thresholds.cutoff), None, thresholds)
    found = [*watcher.take(rows_of(model, log)), *watcher.end()]
    return [one for one in found if isinstance(one, ContactEvent)], watcher.time


def _log(name: str) -> str:
    return str(data_folder() / "ur10e" / f"{name}.parquet")


def _alarms(what: str, count: int, seconds: float) -> Claim:
    """False alarms are no more than promised, or one."""
    return Claim(
        f"false alarms, {what}, for one in 10 min",
        f"{count} in {seconds / 60.0:.1f} min",
        "<= 1 in 10 min",
        count <= max(1.0, seconds / 3600.0 * RATE),
    )


def _pushed(model: IdentifiedModel, what: str, thresholds: ContactThresholds) -> Claim:
    """All pushes are found, and nothing else."""
    pushes, events = pushes_in(_log(PUSHES)), contacts(model, _log(PUSHES), thresholds)[0]
    found = [[e for e in events if e.start < stop and e.end > start] for start, stop in pushes]
    beside = [e for e in events if not any(e in one for one in found)]
    return Claim(
        f"pushes found, {what}",
        f"{sum(map(bool, found))} of {len(pushes)}, {len(beside)} other contacts",
        "4 of 4, 0 other contacts",
        all(found) and len(pushes) == 4 and not beside,
    )


def _unseen(model: IdentifiedModel) -> list[Claim]:
    """Contacts and payloads that are not there."""
    logs = [_log(name) for name in UNSEEN]
    found = [watched(model, log) for log in logs]
    own = sum(isinstance(one, ContactEvent) for some, _ in found for one in some)
    changes = sum(isinstance(one, PayloadEvent) for some, _ in found for one in some)
    seconds = sum(length for _, length in found)
    one, other = (thresholds_of(model, some) for some in (logs[::2], logs[1::2]))
    pairs = [*((log, one) for log in logs[1::2]), *((log, other) for log in logs[::2])]
    count = sum(len(contacts(model, log, thresholds)[0]) for log, thresholds in pairs)
    smoothed, streamed = "thresholds of smoothed logs", "thresholds of every other log as a stream"
    return [
        _alarms(smoothed, own, seconds),
        _alarms(streamed, count, seconds),
        Claim("false changes of the payload there", f"{changes}", "0", changes == 0),
        _pushed(model, smoothed, thresholds_of(model)),
        _pushed(model, streamed, one),
    ]


def main() -> list[Claim]:
    """All of the UR10e; about four minutes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        identified("ur10e", ur10e_logs(), [], output=folder / "model")
        model = steelyard.load_model(folder / "model")
        return _unseen(model)


if __name__ == "__main__":
    main_of(main)
