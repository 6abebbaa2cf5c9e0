"""The UR10e reduced from seven runs and from a single poor one, by every published rule.

The unseen run is the point-to-point one; its errors are means over joints where they move, with
the low-pass of the robot file. Beside the reductions stands the consistent estimate, which removes
nothing.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from proofs.robots.scores import EXAMPLES, ur10e_logs, ur10e_validation
from proofs.support.claims import Claim, data_folder, main_of

import steelyard
from steelyard.estimate.reduction.backward_elimination_and_left_out_errors import (
    CRITERIA,
    FullModel,
    backward,
)
from steelyard.identify.identify import Identification
from steelyard.identify.reduce import ReducedModel

TIMED = True  # nothing else may run beside it

ROBOT = str(EXAMPLES / "ur10e.toml")
POOR = "ur-20_02_06-20sec_5harm"
RULES = (
    ("ours: loss, one standard error", "loss", "one_standard_error"),
    ("loss, Bayesian information", "loss", "bic"),
    ("Wang 2018: contribution, condition 5", "contribution", "condition=5"),
    ("contribution, one standard error", "contribution", "one_standard_error"),
    ("Volkmann 2020: mean column, tolerance 5 %", "mean_column", "tolerance=5"),
    ("Pham 1991: deviation, ratio 30", "deviation", "ratio=30"),
)


def unseen(found: ReducedModel | Identification) -> float:
    """Mean error over joints where they move on the unseen run [%]."""
    (score,) = found.content.scores
    return float(score.mean_percent_moving or np.nan)


def reductions(logs: list[str], folder: Path) -> tuple[float, float, dict[str, ReducedModel]]:
    """Errors of full weighted least squares and of the consistent estimate; every reduction."""
    test = ur10e_validation()
    full = steelyard.identify(ROBOT, logs, test, method="WLS", check=False)
    full.save(folder / "full")
    bodies = steelyard.identify(ROBOT, logs, test, check=False)
    found = {
        name: steelyard.reduce(folder / "full", logs, test, criterion=criterion, stop=stop)
        for name, criterion, stop in RULES
    }
    return unseen(full), unseen(bodies), found


def main() -> list[Claim]:
    """Seven runs, a single one, and the time of a path."""
    data_folder()
    claims, logs = [], ur10e_logs()
    one = [log for log in logs if Path(log).stem == POOR]
    with tempfile.TemporaryDirectory() as folder:
        for name, some in (("seven runs", logs), ("one poor run", one)):
            full, bodies, found = reductions(some, Path(folder) / name.split()[0])
            for rule, reduced in found.items():
                count, whole = len(reduced.kept), len(reduced.reduction.path.full.names)
                ends = unseen(reduced)
                value = f"{count} of {whole} kept, unseen {ends:.2f} % (full {full:.2f} %)"
                same = reduced.reduction.unseen
                assert same is not None
                filtered = [float(same[k].mean()) for k in (0, reduced.reduction.chosen)]
                value += f"; behind the filter of the fit {filtered[1]:.2f} % ({filtered[0]:.2f} %)"
                bound, holds = "printed", True
                if rule.startswith("ours") and some is logs:
                    bound = "<= 30 kept, <= 5.75 % behind the filter"
                    holds = count <= 30 and filtered[1] <= 5.75
                elif rule.startswith("ours"):
                    bound, holds = "<= 7.0 %", ends <= 7.0
                claims.append(Claim(f"{name}: {rule}", value, bound, holds))
            value = f"unseen {bodies:.2f} %, nothing removed"
            claims.append(Claim(f"{name}: consistent estimate", value, "printed", True))
            if some is logs:
                claims.append(_left_out(found[RULES[0][0]]))
                claims.append(_path_time(found[RULES[0][0]].reduction.path.full))
    return claims


def _left_out(reduced: ReducedModel) -> Claim:
    left = reduced.reduction.left_out
    assert left is not None
    ours, full = left.mean[left.sizes.index(len(reduced.kept))], left.mean[0]
    value = f"{ours:.2f} % (full {full:.2f} %)"
    return Claim(
        "seven runs: error on left-out runs, chosen in the others", value, "<= 6.12 %", ours <= 6.12
    )


def _path_time(full: FullModel) -> Claim:
    times = []
    for _ in range(5):
        start = time.perf_counter()
        path = backward(full, CRITERIA[0])
        times.append(time.perf_counter() - start)
    value = f"{1e3 * min(times):.0f} ms for {len(path.steps)} steps"
    return Claim("time of a whole path", value, "<= 200 ms", min(times) <= 0.2)


if __name__ == "__main__":
    main_of(main)
