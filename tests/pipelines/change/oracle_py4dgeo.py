"""py4dgeo's M3C2 on two rasters, in a process of its own: it writes a log where it stands, and its imports warn.

    python oracle_py4dgeo.py IN.npz OUT.npz

IN holds z1, z2 (rows, columns), pitch, radius, max_distance, registration_error, normal_radius, variants (of "mean" and
"median"); OUT what py4dgeo says per measured cell of z1, as VARIANT_distance and so on, VARIANT_cpu, the seconds that
it took without building the clouds, and `peak_mib`, the memory of the process.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt


def points(z: npt.NDArray[np.floating], pitch: float) -> npt.NDArray[np.float64]:
    row, column = np.nonzero(np.isfinite(z))
    return np.stack([column * pitch, row * pitch, z[row, column].astype(np.float64)], axis=1)


def main(source: Path, target: Path) -> None:
    import py4dgeo

    said: dict[str, Any] = {}
    with np.load(source) as given:
        clouds = [points(given[name], float(given["pitch"])) for name in ("z1", "z2")]
        lengths = {name: float(given[name]) for name in ("max_distance", "registration_error")}
        normal_radius, radius = float(given["normal_radius"]), float(given["radius"])
        variants = [str(each) for each in given["variants"]]
    for variant in variants:
        method = py4dgeo.M3C2(
            epochs=[py4dgeo.Epoch(cloud) for cloud in clouds],
            corepoints=clouds[0],
            normal_radii=[normal_radius],
            cyl_radius=radius,
            robust_aggr=variant == "median",
            **lengths,
        )
        start = time.process_time()
        distance, other = method.run()
        said[f"{variant}_cpu"] = time.process_time() - start
        said[f"{variant}_distance"], said[f"{variant}_normals"] = distance, method.directions()
        for ours, theirs in (("lod", "lodetection"), ("n1", "num_samples1"), ("n2", "num_samples2")):
            said[f"{variant}_{ours}"] = other[theirs]
        for name in ("spread1", "spread2"):
            said[f"{variant}_{name}"] = other[name]
    np.savez(target, peak_mib=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, **said)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve())
