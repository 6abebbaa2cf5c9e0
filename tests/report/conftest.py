"""Invented reports, and a browser to look at them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal
from unittest.mock import patch

import numpy as np
import pytest

from browser import Rendered, Tab, look
from steelyard.base.arrays import Parameters
from steelyard.check.all_checks import Diagnosis
from steelyard.check.finding import ComparedHypothesis, Edit, Fix, Picture, Severity, Trace
from steelyard.check.finding import Finding as SaidFinding
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import (
    Estimate,
    Evolution,
    RunParameters,
    StandardEstimate,
    Unidentifiable,
)
from steelyard.estimate.friction.friction_choice import FrictionChoice, MixScore
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap, base_parameters
from steelyard.estimate.nonlinear.effort_scales import EffortScales, Scaled, Scales
from steelyard.estimate.nonlinear.nonlinear_parameters import Finding, ZeroOffsets
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import (
    Bootstrap,
    RepeatedEstimates,
    Sensitivity,
    Variation,
)
from steelyard.estimate.payload.drive_gains import GainEstimate
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.estimate.scores.effort_errors import BandErrors, JointError
from steelyard.estimate.scores.estimator_comparison import Comparison, EstimatorScore, Failure
from steelyard.estimate.scores.parts_and_bands_along_run import TorqueParts
from steelyard.estimate.scores.score import JointScore, RunScore, Traces
from steelyard.identify.comparison.estimators_page import ComparisonContent
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.scores_and_model_report import render, sections_of
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.model import Model
from steelyard.report.page import Section
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Coordinate, Robot

EVIL = "<script>document.body.dataset.errors='ran'</script></script><b>\"'&{{7*7}}"


def robot(joints: tuple[str, ...] = ("shoulder", "elbow")) -> Robot:
    bodies = tuple(
        Body(
            f"link of {joint}",
            joint,
            "revolute",
            k - 1,
            np.eye(3),
            np.array([0.4 * (k > 0), 0.0, 0.0]),
            np.array([0.0, 1.0, 0.0]),
            k,
            inertia=Inertia.about_com(2.0, np.array([0.2, 0.0, 0.0]), np.eye(3) * 0.02),
            known=True,
        )
        for k, joint in enumerate(joints)
    )
    return Robot("invented arm", bodies, tuple(Coordinate(j, "revolute") for j in joints))


def estimate(base: BaseMap, name: str = "weighted least squares", step: float = 0.0) -> Estimate:
    """The last base parameter is not seen, the second cannot be told from zero, the third is weak.

    The first two are correlated by 0.95.
    """
    size = len(base) - 1
    rng = np.random.default_rng(3)
    values = rng.uniform(0.5, 3.0, size)
    std = 0.03 * values
    values[1], values[2] = 0.5 * std[1], 3.0 * std[2]
    correlation = np.eye(size)
    correlation[0, 1] = correlation[1, 0] = 0.95
    return Estimate(
        name,
        Parameters(base.base_names[:-1], base.base_units[:-1], values + step * std),
        correlation * std[:, None] * std,
        (Unidentifiable(base.base_names[-1], (base.base_names[0],)),),
        np.array([0.12, 0.034]),
        np.array([4200.0, 4200.0]),
        812.0,
        41.5,
    )


def evolution(found: Parameters) -> Evolution:
    """A search within bounds that the first value lies at."""
    best = 0.1 + np.exp(-np.arange(30.0) / 5.0)
    lower, upper = found.values - 0.5, found.values + np.arange(len(found.values))
    return Evolution(found.names, lower, upper, best, 1.2 * best, 0.09)


def standard(model: Model) -> StandardEstimate:
    """The nominal values, of which the data tell the second body's mass least."""
    values = np.array([p.prior if p.prior is not None else 0.5 for p in model.parameters])
    std = 0.02 * np.abs(values) + 1e-4
    learned = np.full(len(values), 0.9)
    learned[10] = 0.05
    return StandardEstimate(Parameters(model.names, model.units, values), np.diag(std**2), learned)


def truth(model: Model) -> Parameters:
    """Standard values of a simulated robot, 3 % above those of the file."""
    return Parameters(model.names, model.units, 1.03 * standard(model).parameters.values)


def identified(arm: Robot) -> IdentifiedModel:
    model = Model(arm)
    base = base_parameters(model)
    n = arm.n
    offset = base.base_names[-2], base.base_units[-2]
    drift = tuple(
        RunParameters(run, Parameters(offset[:1], offset[1:], [value]), np.array([0.02]))
        for run, value in (("run1@0.6:9.5", 0.31), ("run2", -0.52))
    )
    signals = Signals(
        "t",
        1.0,
        tuple(f"q{k}" for k in range(n)),
        np.ones(n),
        None,
        None,
        tuple(f"i{k}" for k in range(n)),
        np.ones(n),
        "motor_current",
        ("A",) * n,
        np.full(n, 10.0),
    )
    return IdentifiedModel(
        model,
        base,
        replace(
            estimate(base),
            per_run=drift,
            learned=np.append(np.full(len(base) - 2, 0.93), 0.125),
            standard=standard(model),
            evolution=evolution(estimate(base).parameters),
        ),
        (estimate(base, "ordinary least squares", 1.5),),
        signals,
        Cutoffs(25.0, 8.0, 8.0),
        Provenance("0.1.0", {"log run1.csv": "ab" * 32}, ("run1@0.6:9.5",), ("clock: 100 Hz",)),
    )


def bootstrap(found: IdentifiedModel) -> Bootstrap:
    """Draws that scatter as much as was stated, of the first parameter three times as much."""
    own, std = found.estimate.parameters, found.estimate.std.copy()
    std[0] *= 3.0
    draws = own.values + std * np.random.default_rng(5).standard_normal((50, len(own)))
    return Bootstrap(own, draws, 2, 9)


def repeated(found: IdentifiedModel, name: str = "run") -> RepeatedEstimates:
    """Two estimates that are a standard deviation apart."""
    labels = (f"1 {name}", f"2 {name}")
    steps = (estimate(found.base, step=step) for step in (0.0, 1.0))
    return RepeatedEstimates.of(dict(zip(labels, steps, strict=True)))


def run_score(
    run: str,
    joints: tuple[str, ...] = ("shoulder", "elbow"),
    n_samples: int = 4000,
    error: float = 0.05,
    seed: int = 0,
) -> RunScore:
    rng = np.random.default_rng(seed)
    t = np.arange(n_samples) * 0.01
    waves = [
        5.0 / (k + 1) * np.sin((0.4 + 0.13 * k) * t) + 0.8 * np.sin(2.1 * t + k)
        for k in range(len(joints))
    ]
    measured = np.array(waves).T
    noise = np.convolve(rng.standard_normal(n_samples), np.ones(20) / 20.0, "same")
    predicted = measured + 4.5 * error * measured.std(axis=0) * noise[:, None]
    moving = np.abs(np.sin(0.4 * t))[:, None].repeat(len(joints), axis=1) > 0.15
    scores = tuple(
        JointScore(
            joint,
            "A",
            100.0 * error * (k + 1.5),
            100.0 * error * (k + 1),
            0.1 * (k + 1),
            0.08 * (k + 1),
            0.075 * (k + 1),
            0.06 * (k + 1),
            2.0 + k,
            1.0 + k,
        )
        for k, joint in enumerate(joints)
    )
    errors = tuple(
        JointError(
            joint=joint,
            unit="Nm",
            samples=3000,
            seconds=30.0,
            error=10.0 * error * (2.0 + k),
            used=10.0 * (2.0 + k),
            least=1.0,
            limit=50.0,
        )
        for k, joint in enumerate(joints)
    )
    return RunScore(
        run,
        8.0,
        scores,
        100.0 * error * 1.8,
        100.0 * error,
        BandErrors(5.0, False, errors),
        Traces(
            t,
            measured,
            predicted,
            moving,
            0.1 + 0.1 * np.abs(measured) / 5.0,
            np.abs(measured),
            1.96 * np.hypot(0.1 + 0.1 * np.abs(measured) / 5.0, 0.2),
        ),
        parts=torque_parts(t, measured, predicted, moving),
    )


def torque_parts(
    t: np.ndarray, measured: np.ndarray, predicted: np.ndarray, moving: np.ndarray
) -> TorqueParts:
    """Shares of a predicted effort in amperes, at 10 Nm/A; nothing that is a spring."""
    speed = np.sin(0.7 * t)[:, None] * np.arange(1.0, measured.shape[1] + 1.0)
    shares = np.array([0.5, 0.1, 0.2, 0.2, 0.0])[:, None, None]
    position = np.cos(0.7 * t)[:, None] + 0.0 * speed
    return TorqueParts(
        t[:2000],
        position[:2000],
        speed[:2000],
        moving[:2000],
        10.0 * measured[:2000],
        10.0 * shares * predicted[:2000],
    )


def diagnosis(name: str = "arm", most: float = 1.0) -> Diagnosis:
    """A finding that is wrong, one that is doubtful, and two that are ok; each with a picture."""
    t = 1.7e9 + np.arange(2000.0)
    kinds: tuple[Literal["line", "points", "bars"], ...] = ("line", "points", "bars")
    traces = [Trace(f"{kind} {name}", t, most * np.sin(t), kind) for kind in kinds]
    picture = Picture(f"time {name} [s]", f"effort {name} [A]", tuple(traces))
    fix = Fix(f"say so {name}", (Edit(("signals", "effort", "unit"), f"mA{name}"),))
    rivals = (
        ComparedHypothesis(f"in mA {name}", 4.3, 0.0),
        ComparedHypothesis(name, float("inf"), -most),
    )
    return Diagnosis(
        (
            SaidFinding(f"clock {name}", name, Severity.OK, name, name, (), fix, picture),
            SaidFinding(
                f"unit {name}",
                name,
                Severity.WRONG,
                f"a thousand times too much {name}",
                f"9000 A {name}",
                (name,),
                fix,
                picture,
                rivals,
            ),
            SaidFinding(f"rests {name}", "", Severity.DOUBTFUL, name, "", (name,) * 7),
            SaidFinding("clock", "other", Severity.OK, name, name, (), None, picture),
        )
    )


def friction(name: str = "coulomb") -> FrictionChoice:
    """Two mixes, of which the second was chosen."""
    plain, better = (Coulomb(), Viscous()), (Coulomb(smoothing=0.02), Viscous())
    table = (
        MixScore(f"{name} + viscous", plain, 12.345, 0.0, 0.0),
        MixScore(f"{name} (smoothing 0.02) + viscous", better, 9.87, 20.05, 1.25, True),
    )
    return FrictionChoice(table, "run")


def findings(term: str = "stribeck", joint: str = "elbow") -> tuple[Finding, ...]:
    """One that the data tell, one that they do not."""
    return (
        Finding(term, "speed", None, 0.0512, (0.0431, 0.0612), (0.001, 1.0)),
        Finding(term, "width", joint, 0.002, (1e-4, 0.0034), (1e-4, 0.1)),
    )


def gains(joints: tuple[str, str] = ("shoulder", "elbow")) -> GainEstimate:
    """One that was found, one that was given."""
    covariance = np.diag([0.1**2, 0.0])
    values, sigma = np.array([11.98, 9.83]), np.array([0.1, 0.2])
    return GainEstimate(
        joints,
        values,
        ("Nm/A", "Nm/A"),
        covariance,
        (False, True),
        (False, False),
        False,
        None,
        sigma,
    )


def sensitivity(name: str = "mass", most: float = 3.0) -> Sensitivity:
    """Two fits beside the result, one of which failed."""
    parameters = Parameters((name, f"first moment {name}"), ("kg", "kg m"), [1.0, 2.0])
    result = Variation(1.0, 18.0, 6.0, parameters.values, 4.2, 5.1)
    slower = Variation(0.5, 9.0, 3.0, np.array([most, 2.1]), most, None)
    failed = Variation(2.0, 36.0, 12.0, None, failed=f"too short {name}")
    return Sensitivity(parameters, np.array([0.1, 0.0]), result, (slower, failed))


def comparison(name: str = "", most: float = 9.0) -> Comparison:
    """One estimator that is taken, one that is as good, one that failed once, one for good."""
    joints = (f"shoulder{name}", f"elbow{name}")
    near = np.array([[3.0, 4.0], [5.0, 6.0], [2.0, 5.0]])

    def score(words: str, errors: np.ndarray, **more) -> EstimatorScore:
        given = EstimatorScore(
            f"{words}{name}",
            f"an estimator {name}",
            "information",
            False,
            errors,
            errors.max(axis=1),
            0.012,
            36,
            41.5,
            1.0,
            None,
        )
        return replace(given, **more)

    lost = near.copy()
    lost[1] = np.inf
    sad = Failure(None, f"too few [data] {name}", f"log longer {name}")
    bodies = (f"link 1 {name}", f"link 2 {name}")
    scores = (
        score("WLS", near),
        score("consistent", near + 0.05, impossible=(), seconds=0.12, chi_square=1.004),
        score("plain", near * most, impossible=bodies, condition=most, notes=(f"rough {name}",)),
        score("once", lost, failures=(Failure(f"run2{name}", f"not convex {name}", "try again"),)),
        score("never", near * np.inf, failures=(sad,) * 4, seconds=None, parameters=None),
    )
    runs = tuple(f"run{k}{name}" for k in (1, 2, 3))
    return Comparison(scores, runs, "run", joints, (f"genetic{name}",))


@pytest.fixture(scope="session")
def usual() -> ReportContent:
    return usual_content()


def usual_content() -> ReportContent:
    """Two joints, all sections."""
    quality = (("rows", "4 012"), ("dropped", "12 (not a number)"), ("rate", "100.0 Hz"))
    return ReportContent(
        title="invented arm: identified dynamics",
        robot="invented arm",
        identified=identified(robot()),
        scores=(run_score("points"), run_score("circle", error=0.08, seed=1)),
        fitted=(run_score("run1@0.6:9.5", error=0.03, seed=2),),
        qualities=(("run1", quality), ("points", (*quality, ("gaps", "1, longest 0.4 s")))),
        notes=("joint 'wrist' is locked at 0.3 rad", "velocity: from positions"),
        settings=(("estimator", "weighted least squares"), ("motion cut-off", "25 Hz")),
        friction=friction(),
        findings=findings(),
        gains=gains(),
        zero_offsets=offsets(),
        effort_scales=scales(),
        diagnosis=diagnosis(),
        sensitivity=sensitivity(),
        bootstrap=bootstrap(identified(robot())),
        repeated=repeated(identified(robot())),
        truth=truth(identified(robot()).model),
    )


@pytest.fixture(scope="session")
def compared(usual: ReportContent) -> ComparisonContent:
    return comparison_content(usual, comparison())


@pytest.fixture(scope="session")
def strange(nasty: ReportContent) -> ComparisonContent:
    """Estimators with strange names and numbers that are none."""
    return comparison_content(nasty, comparison(EVIL, float("inf")))


def comparison_content(report: ReportContent, found: Comparison) -> ComparisonContent:
    """Of a comparison with the notes of a report, and what was found before the fit."""
    return ComparisonContent(
        report.title,
        report.robot,
        qualities=report.qualities,
        notes=report.notes,
        settings=report.settings,
        friction=report.friction,
        findings=report.findings,
        gains=report.gains,
        comparison=found,
    )


def scales(joints: tuple[str, str] = ("shoulder", "elbow")) -> EffortScales:
    """One joint that is off, one that is not."""
    values, covariance = np.array([0.72, 1.01]), np.diag([0.05**2, 0.04**2])
    found = Scales(values, covariance, np.zeros(1), 1.0, np.zeros(1))
    knowledge = Knowledge((), (), (), np.zeros(0), np.zeros(0))
    base = BaseMap((), (), (), (), (), np.zeros((0, 0)))
    return EffortScales(joints, found, 2.2, 2.6, Scaled(Consistent(base, knowledge), joints))


def offsets(joints: tuple[str, str] = ("shoulder", "elbow")) -> ZeroOffsets:
    """The first joint's is not identifiable."""
    zero = np.zeros(2)
    std = np.array([np.nan, 0.01])
    return ZeroOffsets(joints, ("rad", "rad"), zero + 0.1, zero, std, (True, True), True)


@pytest.fixture(scope="session")
def nasty() -> ReportContent:
    return nasty_content()


def nasty_content(samples: int = 20_000) -> ReportContent:
    """Names with markup, numbers that are none, ten long joints, no run kept aside."""
    joints = tuple(f"{k} {EVIL}" for k in range(10))
    score = run_score(EVIL, joints, samples)
    broken = score.traces.predicted.copy()
    broken[500:900, 0] = np.nan
    broken[1000, 1] = np.inf
    two = run_score(EVIL, joints[:2], samples).parts
    broken_parts = two.parts.copy()
    broken_parts[:, 500:900, 0] = np.nan
    broken_parts[2, 1000, 1] = np.inf
    broken_parts = replace(two, parts=broken_parts, t=two.t + 1.7e9)
    bad = replace(
        score.joints[0],
        relative_percent=float("nan"),
        relative_percent_moving=None,
        rmse=float("inf"),
        prior_rmse=None,
    )
    lost = replace(score.errors.joints[0], error=float("nan"), used=0.0, limit=None)
    score = replace(
        score,
        joints=(bad, *score.joints[1:]),
        errors=replace(score.errors, joints=(lost, *score.errors.joints[1:])),
        traces=replace(score.traces, predicted=broken, t=score.traces.t + 1.7e9),
        parts=broken_parts,
    )
    evil = identified(robot((f"a{EVIL}", f"b{EVIL}")))
    covariance = evil.estimate.covariance.copy()
    covariance[0, 0] = np.nan
    covariance[3, 3] = 0.0
    drift = tuple(replace(own, run=EVIL) for own in evil.estimate.per_run)
    broken_estimate = replace(
        evil.estimate, covariance=covariance, condition=float("inf"), per_run=drift
    )
    return ReportContent(
        title=EVIL,
        robot=EVIL,
        identified=replace(evil, estimate=broken_estimate),
        fitted=(score,) * 8,
        qualities=((EVIL, ((EVIL, EVIL),)),),
        notes=(EVIL,),
        settings=((EVIL, EVIL),),
        friction=friction(EVIL),
        findings=findings(EVIL, EVIL),
        diagnosis=diagnosis(EVIL, float("nan")),
        gains=replace(gains((EVIL, EVIL)), gains=np.array([np.nan, np.inf])),
        zero_offsets=replace(offsets((EVIL, EVIL)), values=np.array([np.nan, np.inf])),
        effort_scales=scales((EVIL, EVIL)),
        sensitivity=sensitivity(EVIL, float("nan")),
        bootstrap=bootstrap(evil),
        repeated=repeated(evil, EVIL),
        truth=truth(evil.model),
    )


def rendered_only(content: ReportContent, *names: str) -> str:
    """A page of some of its sections, which a browser draws in half of the time."""

    def chosen(content: ReportContent) -> list[Section]:
        return [section for section in sections_of(content) if section.name in names]

    with patch("steelyard.identify.scores_and_model_report.sections_of", chosen):
        return render(content)


@pytest.fixture(scope="session")
def browse(browser: Tab, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Rendered]:
    """Open a page in headless Chromium, and run a script in it."""

    def open_page(page: str, script: str = "") -> Rendered:
        file = tmp_path_factory.mktemp("page") / "report.html"
        file.write_text(page, encoding="utf-8")
        return look(browser, file, script)

    return open_page
