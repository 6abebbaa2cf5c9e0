"""Bounds of a study as claims."""

import tempfile
from pathlib import Path
from typing import Any

from proofs.support.claims import Claim
from studies.support.study import Study, whole_page

SEEDS = 4
"""Of the 20 of a study's page (`python studies/NAME.py -o DIR`), for the time of all proofs."""


def claims_of(study: Study[Any]) -> list[Claim]:
    """Run a study with some of its seeds; its bounds."""
    with tempfile.TemporaryDirectory() as folder:
        page = whole_page(study, Path(folder), SEEDS)
    return [Claim(one.name, one.value, one.bound, one.holds) for one in page.claims]
