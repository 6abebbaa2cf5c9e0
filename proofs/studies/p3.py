"""Every bound of the study of consistent identification and wrenches, with some seeds."""

from proofs.support.claims import Claim, main_of
from proofs.support.studies import claims_of
from studies.p3_consistent_wrench import STUDY


def main() -> list[Claim]:
    """The study's bounds."""
    return claims_of(STUDY)


if __name__ == "__main__":
    main_of(main)
