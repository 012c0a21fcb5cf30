"""A store's metrics as one DataFrame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["frame_of"]


def frame_of(
    times: npt.NDArray[np.datetime64],
    numbers: npt.NDArray[np.int64],
    columns: Mapping[str, npt.NDArray[np.float64]],
    units: Mapping[str, str],
) -> pd.DataFrame:
    """Put metrics side by side.

    Parameters
    ----------
    times : ndarray of datetime64[ns], shape (scan,)
        UTC.
    numbers : ndarray of int64, shape (scan,)
    columns : mapping of str to ndarray of float64, shape (scan,)
        ``NAME`` and ``NAME_sigma`` of each metric; NaN where it was not measured.
    units : mapping of str to str
        By metric name; goes to ``attrs["units"]``.
    """
    import pandas as pd

    index = pd.DatetimeIndex(times, name="time").tz_localize("UTC")
    frame = pd.DataFrame({"scan": numbers, **columns}, index=index)
    frame.attrs["units"] = dict(units)
    return frame
