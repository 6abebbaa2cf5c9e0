"""The pick of `payload_pick` as a stream: up at 13 s, down at 54 s; ten minutes without payload."""

import tempfile
from pathlib import Path

from proofs.support.claims import Claim, main_of
from proofs.uses.payload_pick import MASS, PICK, RELEASE, ROBOT, TOLERANCE, logs
from proofs.uses.watch_ur10e import rows_of

from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.identify.identify import identify
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvent
from steelyard.uses.watch.watch import start_watch
from steelyard.uses.watch.watcher_and_events import SEARCH_PERIOD

LATEST = 3.0 + 2.0 * SEARCH_PERIOD + 0.5
"""Time after a change by which it is reported [s]: motion on both sides, two searches."""


def changes(model: IdentifiedModel, log: Path) -> list[tuple[float, PayloadEvent]]:
    """Changes of the payload, and when they are reported [s]."""
    watcher = start_watch(model).watcher
    taken = watcher.take(rows_of(model, str(log)))  # sample by sample, each before the next
    return [(watcher.time, one) for one in taken if isinstance(one, PayloadEvent)]


def main() -> list[Claim]:
    """Times, masses, delays; no change in ten minutes without payload."""
    with tempfile.TemporaryDirectory() as name:
        *fit, pick, free = logs(Path(name))
        model = identify(ROBOT, fit).model
        found, quiet = (changes(model, log) for log in (pick, free))
    kinds = [one.kind for _, one in found]
    pairs = list(zip([one for _, one in found], (PICK, RELEASE), strict=False))
    inside = all(abs(one.mass - MASS) <= one.mass_half_width for one, _ in pairs)
    delays = [at - one.time for at, one in found]
    return [
        Claim(
            "changes of a stream",
            ", ".join(f"{one.kind} {one.time:.2f} s" for _, one in found),
            f"13 s, 54 s ± {TOLERANCE} s",
            kinds == ["picked up", "put down"]
            and all(abs(one.time - when) <= TOLERANCE for one, when in pairs),
        ),
        Claim(
            "masses of 2 kg",
            ", ".join(f"{one.mass:.2f} ± {one.mass_half_width:.2f} kg" for _, one in found),
            "in the intervals",
            inside and bool(pairs),
        ),
        Claim(
            "reported after",
            ", ".join(f"{delay:.1f} s" for delay in delays),
            f"<= {LATEST:g} s",
            bool(delays) and max(delays) <= LATEST,
        ),
        Claim("changes in ten minutes without payload", f"{len(quiet)}", "0", not quiet),
    ]


if __name__ == "__main__":
    main_of(main)
