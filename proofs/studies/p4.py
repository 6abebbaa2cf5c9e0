"""Every bound of the study of seven joints, with some seeds."""

from proofs.support.claims import Claim, main_of
from proofs.support.studies import claims_of
from studies.p4_seven_joints import STUDY


def main() -> list[Claim]:
    """The study's bounds."""
    return claims_of(STUDY)


if __name__ == "__main__":
    main_of(main)
