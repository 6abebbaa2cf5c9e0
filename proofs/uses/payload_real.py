"""Payloads of a real UR10e: physically consistent bodies, intervals, and logs without payload.

2.805 kg is what the data's authors state of the log of 2020-02-19. No payload was set in the
controller. Efforts are motor currents, gains known within 2 % each.
"""

from proofs.robots.payload_and_gains import EMPTY, OTHERS, PAIR, ROBOT, log
from proofs.support.claims import Claim, main_of

from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.identify.identify import identify
from steelyard.uses.payload.payload import identify_payload, payload_events

MASS = 2.805
LOADED = (PAIR[1], "ur-20_01_31-load")


def _loaded(name: str, found: PayloadEstimate) -> list[Claim]:
    half = found.half_width[0]
    return [
        Claim(
            f"{name}: mass",
            f"{found.mass:.3f} ± {half:.3f} kg (± {100.0 * half / MASS:.1f} %)",
            "contains 2.805 kg, <= ± 4 %",
            abs(found.mass - MASS) <= half <= 0.04 * MASS,
        ),
        Claim(
            f"{name}: inertia",
            f"χ² rises by {found.chi_squared:.1f}",
            "a physically consistent body",
            found.flaw is None and not found.not_seen,
        ),
    ]


def main() -> list[Claim]:
    """Two loaded and three unloaded logs against a model of six others; one of the same motion."""
    model = identify(ROBOT, [log(name) for name in OTHERS]).model
    same = identify(ROBOT, [log(PAIR[0])]).model
    claims = [
        *(claim for name in LOADED for claim in _loaded(name, identify_payload(model, log(name)))),
        *_loaded("model of the same motion", identify_payload(same, log(PAIR[1]))),
    ]
    for name in EMPTY:
        found = identify_payload(model, log(name))
        half = found.half_width[0]
        events = payload_events(model, log(name))
        claims.append(
            Claim(
                f"{name}, unloaded",
                f"{found.mass:.3f} ± {half:.3f} kg, {len(events.events)} events",
                "contains zero, no event, nothing carried",
                found.mass <= half and not events.events and not events.carried,
            )
        )
    return claims


if __name__ == "__main__":
    main_of(main)
