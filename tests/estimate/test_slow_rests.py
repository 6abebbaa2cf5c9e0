"""Changes at rest of logs with too few samples."""

import numpy as np

from steelyard.estimate.external.contact_thresholds import CREEP, changes_at_rest


def test_logs_slower_than_creep_are_not_tested() -> None:
    step = 4.0 * CREEP
    t = step * np.arange(40.0)
    found = changes_at_rest(t, np.ones((2, 40)), np.zeros((2, 40), dtype=np.intp), step)
    assert found.shape == (2, 40) and np.isnan(found).all()
