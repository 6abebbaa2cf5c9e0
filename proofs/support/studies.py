"""Bounds of a study as claims."""

import tempfile
from pathlib import Path
from typing import Any

from proofs.support.claims import Claim
from studies.support.study import Study, whole_page


def claims_of(study: Study[Any]) -> list[Claim]:
    """Run a whole study; its bounds."""
    with tempfile.TemporaryDirectory() as folder:
        page = whole_page(study, Path(folder))
    return [Claim(one.name, one.value, one.bound, one.holds) for one in page.claims]
