"""Bootstrap over windows: against known scatter, and on data that refuse it."""

from dataclasses import dataclass
from dataclasses import replace as with_

import numpy as np
import pytest

from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.base.progress import Event, Stopped
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import Layout
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import bootstrap

LAYOUT = Layout(("mean", "rest"), ("Nm", "Nm"), ("joint",), ((0, 1),))


def windows(seed: int, count: int = 40, size: int = 50, spread: float = 0.0) -> Information:
    """Blocks of measurements of a constant; `spread` is common to a block."""
    rng = np.random.default_rng(seed)
    grams = []
    for _ in range(count):
        columns = np.column_stack([np.ones(size), rng.normal(size=size)])
        effort = 3.0 + rng.normal(size=size) + spread * rng.normal()
        joined = np.column_stack([columns, effort])
        grams.append((joined.T @ joined)[np.tril_indices(3)])
    return Information(
        LAYOUT,
        Signature("model", LAYOUT.columns, ("Nm",), "none"),
        tuple(Window("run", float(k), k + 1.0) for k in range(count)),
        np.array(grams),
        np.zeros((count, 3)),
        np.full((count, 1), float(size)),
    )


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 1.0])
def test_the_scatter_is_that_of_block_means(spread: float) -> None:
    found = bootstrap(OrdinaryLeastSquares(), windows(0, spread=spread), draws=150)
    wanted = np.sqrt((1.0 / 50 + spread**2) / 40)
    assert found.std[0] == pytest.approx(wanted, rel=0.25)
    lower, upper = found.interval()
    assert upper[0] - lower[0] == pytest.approx(2 * 1.96 * found.std[0], rel=0.15)
    assert lower[0] < found.parameters["mean"] < upper[0]


@pytest.mark.slow
def test_few_windows_are_not_taken_for_sure() -> None:
    stds = [bootstrap(OrdinaryLeastSquares(), windows(k, 3), draws=20).std[0] for k in range(30)]
    wanted = np.sqrt(1.0 / 150)
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(wanted, rel=0.15)


def test_a_seed_gives_the_same_draws() -> None:
    estimator, data = WeightedLeastSquares(), windows(1)
    first, again, other = (
        bootstrap(estimator, data, draws=20, seed=seed).draws for seed in (4, 4, 5)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_each_run_keeps_its_number_of_windows() -> None:
    data = windows(2, 6)
    named = with_(
        data, windows=tuple(with_(w, run=f"r{k % 2}") for k, w in enumerate(data.windows))
    )
    seen: list[list[str]] = []

    def watch(information: Information) -> Estimate:
        seen.append(sorted(w.run for w in information.windows))
        return OrdinaryLeastSquares()(information)

    found = bootstrap(watch, named, draws=5)
    assert seen == [["r0"] * 3 + ["r1"] * 3] * 6
    assert found.windows == 6


def test_progress_is_reported_and_may_stop() -> None:
    events: list[Event] = []

    def stop(event: Event) -> bool:
        events.append(event)
        return event.done < 3

    with pytest.raises(Stopped):
        bootstrap(OrdinaryLeastSquares(), windows(3), draws=10, progress=stop)
    assert [event.done for event in events] == [1, 2, 3] and events[0].total == 10


def test_one_window_per_run_is_refused() -> None:
    with pytest.raises(DataError, match="needs several windows"):
        bootstrap(OrdinaryLeastSquares(), windows(4, 1))


@dataclass
class Moody:
    """An estimator that fails from its second call on, but for every so many."""

    good: int
    calls: int = 0

    def __call__(self, information: Information) -> Estimate:
        self.calls += 1
        if self.calls > 1 and self.calls % self.good:
            raise DataError("no", where="here", fix="there")
        return OrdinaryLeastSquares()(information)


def test_failed_draws_are_counted() -> None:
    def seldom(information: Information) -> Estimate:
        return moody(information)

    moody = Moody(good=1)
    assert bootstrap(seldom, windows(5), draws=10).failed == 0
    moody = Moody(good=5)
    with pytest.raises(DataError, match="only 2 of 10 bootstrap draws"):
        bootstrap(seldom, windows(5), draws=10)


def test_a_parameter_that_a_draw_does_not_show_is_left_out() -> None:
    calls = 0

    def half_blind(information: Information) -> Estimate:
        nonlocal calls
        calls += 1
        whole = OrdinaryLeastSquares()(information)
        if calls % 2:
            return whole
        first = Parameters(("mean",), ("Nm",), whole.parameters.values[:1])
        return with_(whole, parameters=first, covariance=whole.covariance[:1, :1])

    found = bootstrap(half_blind, windows(6), draws=20)
    assert np.isnan(found.draws[:, 1]).sum() == 10 and np.isfinite(found.std).all()


def test_json_holds_values_and_intervals() -> None:
    printed = bootstrap(OrdinaryLeastSquares(), windows(7), draws=30).to_dict()
    assert printed["draws"] == 30 and printed["failed"] == 0 and printed["windows"] == 40
    first = printed["parameters"][0]
    assert first["name"] == "mean" and first["lower95"] < first["value"] < first["upper95"]
