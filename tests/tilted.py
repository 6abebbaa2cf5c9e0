"""Arms whose parallel and perpendicular axes are tilted a little, as calibrated model files are."""

import numpy as np
from numpy.typing import NDArray

from steelyard.robot.inertia_and_placement import turn
from steelyard.robot.robot import Body, Coordinate, Robot

QUARTER = np.pi / 2.0
Rows = tuple[tuple[float, tuple[float, float, float]], ...]

ARMS: dict[str, Rows] = {
    # the turn about x from the joint before, and the way [m]
    "elbow": (
        (0.0, (0.0, 0.0, 0.2)),
        (QUARTER, (0.0, 0.1, 0.0)),
        (0.0, (0.6, 0.0, 0.0)),
        (0.0, (0.5, 0.0, 0.1)),
        (QUARTER, (0.0, -0.1, 0.0)),
        (-QUARTER, (0.0, 0.1, 0.0)),
    ),
    "spherical": (
        (0.0, (0.0, 0.0, 0.3)),
        (-QUARTER, (0.0, 0.0, 0.0)),
        (QUARTER, (0.0, -0.3, 0.0)),
        (QUARTER, (0.08, 0.0, 0.0)),
        (-QUARTER, (-0.08, 0.4, 0.0)),
        (QUARTER, (0.0, 0.0, 0.0)),
        (QUARTER, (0.09, 0.0, 0.0)),
    ),
    "planar": ((QUARTER, (0.0, 0.0, 0.2)), (0.0, (0.3, 0.0, 0.0)), (0.0, (0.3, 0.0, 0.0))),
    "scara": ((0.0, (0.0, 0.0, 0.2)), (0.0, (0.3, 0.0, 0.0)), (0.0, (0.3, 0.0, 0.0))),
}


def tilted(name: str, tilts: NDArray[np.float64]) -> Robot:
    """An arm whose joint frames are turned by `tilts`, shape `(n, 3)` [rad]."""
    bodies = []
    for k, ((about, way), tilt) in enumerate(zip(ARMS[name], tilts, strict=True)):
        angle = float(np.linalg.norm(tilt))
        placed = turn([1.0, 0.0, 0.0], about) @ turn(tilt / angle if angle else tilt, angle)
        bodies.append(
            Body(f"link{k + 1}", f"j{k + 1}", "revolute", k - 1, placed, way, [0.0, 0.0, 1.0], k)
        )
    joints = tuple(Coordinate(f"j{k + 1}", "revolute") for k in range(len(bodies)))
    return Robot(name, tuple(bodies), joints)


def drawn(seed: int) -> Robot:
    """An arm of which every joint is tilted by 1e-5 to 1e-2 rad, or not at all."""
    rng = np.random.default_rng(seed)
    name = list(ARMS)[seed % len(ARMS)]
    ways = rng.normal(size=(len(ARMS[name]), 3))
    ways *= 10.0 ** rng.uniform(-5.0, -2.0) / np.linalg.norm(ways, axis=1, keepdims=True)
    return tilted(name, ways * rng.integers(0, 2, size=(len(ways), 1)))


def singular_values(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the columns, scaled to unit length; those that are rounding errors are left out."""
    norms = np.linalg.norm(matrix, axis=0)
    seen = norms > 1e-9 * norms.max()
    values: NDArray[np.float64] = np.linalg.svd(matrix[:, seen] / norms[seen], compute_uv=False)
    return values


def rank_by_gap(matrix: NDArray[np.float64]) -> int:
    """Rank by singular values: before the largest gap that ends below 1e-3 of the largest one."""
    values = singular_values(matrix)
    sizes = np.maximum(np.append(values / values[0], 0.0), 1e-14)
    ends = [k for k in range(1, len(sizes)) if sizes[k] < 1e-3 and sizes[k - 1] > 1e-10]
    return max(ends, key=lambda k: sizes[k - 1] / sizes[k])
