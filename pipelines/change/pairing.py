"""Who is who: what is seen now and what was known before, paired one to one so that all pairs together cost least."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["paired"]


def paired(cost: npt.NDArray[np.float64], allowed: npt.NDArray[np.bool_], alone: float) -> dict[int, int]:
    """Pair rows with columns by the assignment of the least sum of costs (Kuhn 1955).

    Parameters
    ----------
    cost : ndarray of float64, shape (now, before)
    allowed : ndarray of bool, shape (now, before)
        Which may be a pair at all.
    alone : float
        What it costs to leave a pair apart. Far above all costs, as many pairs as possible are made; where costs are
        below it, only what they are worth.

    Returns
    -------
    dict of int to int
        Column of each row that has a partner.
    """
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.where(allowed, cost, alone))
    return {int(row): int(column) for row, column in zip(rows, columns, strict=True) if allowed[row, column]}
