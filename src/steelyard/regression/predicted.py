"""Information with each row's predicted effort as one more column."""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.regression.information import Information
from steelyard.regression.regressor import Layout


def with_predicted(
    information: Information, values: Array, names: Sequence[str], added: Array
) -> Information:
    """The same data with one column per row, in that row alone: its effort as predicted.

    Sums of |column| do not transform; they are not a number in the result.

    Args:
        information: What the data say.
        values: Of its columns, shape `(p,)`; they make the predicted efforts.
        names: Of the new columns, one per row.
        added: Share of the predicted effort that is added to that of each row, shape `(rows,)`.
    """
    old, p = information.layout, len(information.layout.columns)
    sees = tuple((*seen, p + row) for row, seen in enumerate(old.sees))
    columns = (*old.columns, *names)
    layout = Layout(columns, (*old.units, *["1"] * len(names)), old.rows, sees)
    parts = []
    for row, seen in enumerate(old.sees):
        k, mine = len(seen), values[list(seen)]
        part = np.zeros((k + 1, k + 2))
        part[:k, :k] = np.eye(k)
        part[:k, k], part[:k, k + 1] = mine, added[row] * mine
        part[k, k + 1] = 1.0
        parts.append(part)
    return information.mapped(layout, parts)
