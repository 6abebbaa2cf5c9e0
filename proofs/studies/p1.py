"""Every bound of the study of the leg, with some seeds."""

from proofs.support.claims import Claim, main_of
from proofs.support.studies import claims_of
from studies.p1_reduction import STUDY


def main() -> list[Claim]:
    """The study's bounds."""
    return claims_of(STUDY)


if __name__ == "__main__":
    main_of(main)
