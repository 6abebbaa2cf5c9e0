"""Every estimator by its name: a model comes of it, or a reason why not."""

from pathlib import Path

import pytest

import steelyard
from small_arm import URDF
from steelyard.base.errors import ModelError, SteelyardError
from steelyard.base.progress import silent
from steelyard.estimate.estimator_register import ESTIMATORS, Sources
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import write_motion
from steelyard.identify.identify import Identification

pytestmark = pytest.mark.usefixtures("few_stretches")

BODIES = {"consistent", "pullback", "SDP"}
"""Estimators that give values of all standard parameters."""

BOUNDED = "[estimation.genetic]\npopulation = 100\ngenerations = 1000\n" + "".join(
    f'[[knowledge]]\nkind = "parameter"\nparameter = "{name}.*"\nlower = {low}\nupper = {high}\n'
    for name, low, high in (
        ("viscous", 0.0, 2.0),
        ("coulomb", 0.0, 4.0),
        ("rotor_inertia", 0.0, 0.5),
        ("offset", -1.0, 1.0),
    )
)
"""What the genetic algorithm needs: bounds of all but the links."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("method")
    (place / "arm.urdf").write_text(URDF)
    (place / "arm.toml").write_text('[robot]\nurdf = "arm.urdf"\n')
    steelyard.simulate(place / "arm.toml", place / "run", period=5.0, seed=1)
    return place


def log(folder: Path) -> Path:
    return folder / "run" / "log.csv"


def found(folder: Path, robot: str = "", **options: object) -> Identification:
    path = folder / "arm.toml"
    if robot:
        path = folder / "other.toml"
        path.write_text(f'[robot]\nurdf = "arm.urdf"\n{robot}')
    return steelyard.identify(path, log(folder), check=False, **options)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("offer", ESTIMATORS, ids=lambda offer: offer.name)
def test_a_model_comes_of_every_estimator(folder: Path, offer, tmp_path: Path) -> None:
    result = found(folder, BOUNDED if offer.name == "genetic" else "", method=offer.name)
    estimate = result.model.estimate
    assert (estimate.standard is not None) == (offer.name in BODIES)
    assert result.scores["percent_of_used"].max() < 2.0
    details = result.content.details
    notes = [note for note in details if note.startswith("estimated by")]
    if offer.name == "consistent":
        assert not notes
    else:
        (note,) = notes
        assert note.startswith(f"estimated by {offer.name} ({offer.about}), as requested")
        assert ("invalid" in note) == (offer.name not in BODIES)
    calibrated = result.model.calibration is not None
    assert calibrated == (offer.needs != "experiment")
    bands = [note for note in details if "95 % bands" in note]
    assert bool(bands) != calibrated and all(f"{offer.name} needs whole runs" in b for b in bands)
    again = steelyard.load_model(result.save(tmp_path / "out"))
    assert again.estimate.estimator == estimate.estimator
    assert estimate.estimator in result.report()


@pytest.mark.slow
def test_whole_runs_calibrate_what_simulates(folder: Path) -> None:
    robot = folder / "arm.toml"
    arm, motion = steelyard.load_robot(robot).robot, folder / "drawn.json"
    write_motion(motion, random_fourier(arm, seed=2, period=5.0), arm)
    steelyard.simulate(robot, folder / "other", motion, seed=1)
    logs = [log(folder), folder / "other" / "log.csv"]
    result = steelyard.identify(robot, logs, check=False, method="didim")
    assert result.model.calibration is not None and result.model.calibration.kind == "runs"


@pytest.mark.slow
def test_the_robot_file_and_the_option_take_the_same_names(folder: Path) -> None:
    of_file = found(folder, '[estimation]\nmethod = "Bounded_LS"\n')
    of_option = found(folder, '[estimation]\nmethod = "Huber"\n', method="bounded LS")
    one, other = (result.model.estimate for result in (of_file, of_option))
    assert one.estimator == other.estimator
    assert one.parameters.values.tolist() == other.parameters.values.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(("weights", "name"), [("noise", "WLS"), ("equal", "OLS")])
def test_least_squares_weighs_as_the_robot_file_says(folder: Path, weights: str, name: str) -> None:
    robot = f'[estimation]\nmethod = "least_squares"\nweights = "{weights}"\n'
    one = found(folder, robot).model
    other = found(folder, f'[estimation]\nmethod = "{name.lower()}"\n').model
    assert one.estimate.parameters.values.tolist() == other.estimate.parameters.values.tolist()
    assert one.reference[0].estimator == other.reference[0].estimator != one.estimate.estimator


def test_unknown_names_are_refused_where_they_stand(folder: Path) -> None:
    with pytest.raises(ModelError) as caught:
        found(folder, '[estimation]\nmethod = "Hubber"\n')
    assert caught.value.wrong == "there is no estimator 'Hubber'"
    assert "other.toml, line 4" in caught.value.where and "'Huber'" in caught.value.fix
    with pytest.raises(ModelError) as caught:
        found(folder, method="least_square")
    assert caught.value.where == "method (--method)" and "'least_squares'" in caught.value.fix
    with pytest.raises(ModelError, match="no estimator 'GA'"):
        found(folder, method="GA")
    with pytest.raises(ModelError, match="no estimator 'WSL'"):
        (folder / "other.toml").write_text(
            '[robot]\nurdf = "arm.urdf"\n[estimation]\nmethod = "WSL"\n'
        )
        steelyard.check(folder / "other.toml", log(folder))


def test_what_cannot_be_had_is_refused_with_a_way_out(folder: Path) -> None:
    own = '[model]\nterms = ["rigid_body", "viscous", {law = "offset", per_run = true}]\n'
    with pytest.raises(SteelyardError) as caught:
        found(folder, own, method="RLS")
    assert caught.value.wrong == "it does not estimate parameters per run"
    assert "use another estimator, or leave per_run = true out" in caught.value.fix


@pytest.mark.slow
def test_a_bootstrap_of_other_data_is_declined(folder: Path) -> None:
    result = found(folder, method="huber", bootstrap=20)
    assert result.content.bootstrap is None
    assert "no bootstrap: Huber needs samples, which cannot be resampled" in result.content.notes
    assert found(folder, method="ridge", bootstrap=20).content.bootstrap is not None


@pytest.mark.slow
def test_other_cutoffs_are_fitted_with_the_same_estimator(folder: Path) -> None:
    result = found(folder, method="Huber", sensitivity=True)
    fits = result.content.sensitivity
    assert fits is not None
    values = [one.values for one in fits.variations if one.values is not None]
    assert values and all(abs(v - fits.result.values).max() > 0.0 for v in values)


def test_samples_are_those_summed_up_in_the_windows(folder: Path) -> None:
    model = steelyard.model_of(folder / "arm.toml")
    runs = steelyard.load_runs(folder / "arm.toml", log(folder))
    information = steelyard.information(model, runs)
    sources = Sources(base_regressor(model), runs, information, 1, silent)
    share = information.n_samples / [len(row) for row in sources.samples(information).rows]
    for chosen in ([0, 1, 2], [1, 5], [7]):
        part = information.of(chosen)
        counts = [len(row) for row in sources.samples(part).rows]
        assert (part.n_samples / counts).tolist() == pytest.approx(share.tolist())


@pytest.mark.slow
def test_runs_too_short_for_a_choice_have_coulomb_and_viscous_friction(folder: Path) -> None:
    robot = '[model]\nterms = ["rigid_body", "rotor_inertia", "offset"]\nfriction = "auto"\n'
    path = folder / "short.toml"
    path.write_text(f'[robot]\nurdf = "arm.urdf"\n{robot}')
    result = steelyard.identify(path, f"{log(folder)}@0:2.2", check=False)
    laws = [term.law for term in result.model.model.terms]
    assert laws == ["rigid_body", "rotor_inertia", "offset", "coulomb", "viscous"]
    assert any("too short to compare friction laws" in note for note in result.content.notes)


@pytest.mark.slow
def test_the_genetic_algorithm_shows_bounds_and_generations(folder: Path) -> None:
    few = BOUNDED.replace("1000", "40")
    result = found(folder, f'[estimation]\nmethod = "genetic"\n{few}')
    search = result.model.estimate.evolution
    assert search is not None and len(search.best) == 40
    shown = result.to_dict()["evolution"]
    assert shown["best"] == search.best.tolist() and shown["names"] == list(search.names)
    page = result.report()
    assert "Bounds of the search" in page and "Best and mean root mean square error" in page
    with pytest.raises(SteelyardError, match="no bounds to search between for rotor_inertia"):
        found(folder, method="genetic")
    with pytest.raises(SteelyardError, match="population"):
        found(folder, "[estimation.genetic]\npopulation = 1\n")
