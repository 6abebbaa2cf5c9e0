"""The checks find faults that are put into clean logs, and correct them.

Real logs of three robots, each against a model identified from other clean stretches, and the
simulated demo arm. Every draw runs all checks. A verdict is right if a check that should
says so and no other one says "wrong"; a fix is right if the corrected robot file reads the
faulty log as the clean file reads the clean one (fitted gains within 10 %, masses within 10 %,
delays within half a row or 10 %).
"""

import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.fault_kinds import KINDS, Kind, real_payload
from proofs.support.faults import Clean, Faulty, Tally, diagnosis, right_fix, right_verdict

from steelyard.base.progress import silent
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.decision.ranked_readings import ranking
from steelyard.check.hypotheses.gravity_payload_and_delay import delay_fit
from steelyard.estimate.identified_model import IdentifiedModel, Provenance
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.fit import fit
from steelyard.identify.fit_preparation import FitTask
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import parse_log_argument
from steelyard.model.model import model_with_open_friction, with_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.runs_of_named_logs import prepared
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.simulate import write_demo_arm

DRAWS = 20
SEED = 20_260_726
EXAMPLES = Path(__file__).parents[2] / "examples"
FITTED = {
    "ur10e": [
        f"ur10e/identification/ur-20_02_{n}.parquet"
        for n in ("05-20sec_8harm", "05-20sec_12harm", "10-30sec_12harm")
    ],
    "panda": ["panda/panda_gaz2019_trajectory1.parquet@0.6:9.5"],
    "rokae_ar5": ["rokae_ar5/ar5_run1_rows0_2300.parquet@0:30"],
}
FRESH = {
    "ur10e": [
        f"ur10e/identification/ur-20_{n}.parquet"
        for n in (
            "02_06-20sec_5harm",
            "02_10-20sec_7harm",
            "02_12-40sec_12harm",
            "02_19_14harm50sec",
            "01_31-unload",
        )
    ]
    + ["ur10e/identification/ur-19_12_23_free.parquet"],
    "panda": ["panda/panda_gaz2019_trajectory1.parquet@9.5:20.5"],
    "rokae_ar5": ["rokae_ar5/ar5_run1_rows0_2300.parquet@30:46"],
}
LOADED = {
    "14harm50secLoad": ("02_19_14harm50secLoad", 2.805),
    "load_2600": ("01_13-load_2600", 2.6),
}


def columns_and_table(argument: str, loaded: LoadedRobot) -> tuple[tuple[str, ...], np.ndarray]:
    """The window of a log, with the columns that the robot file declares."""
    path, cut = parse_log_argument(argument)
    if loaded.signals is None:
        raise ValueError(f"{argument}: no signals")
    columns = loaded.signals.columns
    table = np.concatenate(list(open_log(path).parts(columns)))
    t = table[:, 0] - table[0, 0]
    return columns, table[(t >= cut.seconds[0]) & (t < cut.seconds[1])]


def reference_of(loaded: LoadedRobot, recordings: list[Recording]) -> IdentifiedModel:
    """The customary model, identified."""
    wanted = Processing(
        motion_cutoff=loaded.processing.motion_cutoff,
        matched_cutoff=loaded.processing.matched_cutoff,
    )
    runs = prepared(recordings, wanted, silent)
    plain = replace(loaded, friction=False)
    model = with_friction(model_with_open_friction(loaded), loaded)
    origin = Provenance("", {}, (), ())
    return fit(FitTask(model, plain, runs), origin).identified


def real(robot: str, data: Path) -> list[Clean]:
    """Fresh logs of a robot with a reference from others."""
    path = EXAMPLES / f"{robot}.toml"
    loaded = load_robot(path)
    recordings = []
    for argument in FITTED[robot]:
        log, cut = parse_log_argument(str(data / argument))
        if loaded.signals is None:
            raise ValueError(f"{path}: no signals")
        recordings.append(Recording(open_log(log), loaded.signals, cut))
    reference = reference_of(loaded, recordings)
    text = path.read_text()
    return [
        known(
            Clean(
                robot,
                Path(a).stem,
                path,
                text,
                *columns_and_table(str(data / a), loaded),
                reference,
            )
        )
        for a in FRESH[robot]
    ]


def loaded_logs(clean: Clean, data: Path) -> dict[str, Clean]:
    """Logs of the UR10e with payloads."""
    folder, own = data / "ur10e" / "identification", clean.loaded
    return {
        name: replace(
            clean, name=name, table=columns_and_table(f"{folder}/ur-20_{file}.parquet", own)[1]
        )
        for name, (file, _) in LOADED.items()
    }


def simulated(folder: Path) -> list[Clean]:
    """The demo arm: torque of an invented truth along random motions, with noise."""
    folder.mkdir()
    loaded = write_demo_arm(folder)
    path = next(folder.glob("*.toml"))
    if loaded.signals is None:
        raise ValueError(f"{path}: no signals")
    truth = random_truth(loaded.robot, SEED)
    columns, tables = loaded.signals.columns, []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        trajectory = random_fourier(loaded.robot, seed=seed, period=10.0, periods=2)
        t = np.arange(0.0, trajectory.duration, 0.004)
        m = trajectory.sample(t)
        tau = truth.model.at(truth.values).torque(m)
        tau = tau + 0.02 * np.std(tau, axis=0) * rng.standard_normal(tau.shape)
        q = m.q + 2e-5 * rng.standard_normal(m.q.shape)
        dq = [m.dq + 1e-3 * rng.standard_normal(m.dq.shape)] if loaded.signals.velocity else []
        scale = loaded.signals.gains * loaded.signals.effort_scale
        tables.append(np.column_stack([t, q, *dq, tau / scale]))
    logs = [LogInMemory(Path(f"draw{k}"), columns, table) for k, table in enumerate(tables)]
    signals = loaded.signals
    reference = reference_of(loaded, [Recording(log, signals) for log in logs[:2]])
    text = path.read_text()
    return [
        known(Clean("demo arm", f"draw{k}", path, text, columns, tables[k], reference))
        for k in (2, 3)
    ]


def known(clean: Clean) -> Clean:
    """The log with what the reference says of it as it is."""
    loaded = clean.loaded
    recording = Recording(LogInMemory(Path(clean.name), clean.columns, clean.table), clean.signals)
    processing = Processing(
        motion_cutoff=loaded.processing.motion_cutoff,
        matched_cutoff=loaded.processing.matched_cutoff,
    )
    log = CheckedLog(recording, processing, clean.name)
    found = ranking(Case(loaded, (log,), clean.reference), log)
    if found is None:
        raise ValueError(f"{clean.name} holds no motion")
    delay, std = delay_fit(found.declared.reading)
    found_delay = delay if np.isfinite(std) else 0.0
    return replace(clean, delay=found_delay, misfits=found.declared.misfits)


QUIRKS = {("panda", "clock")}
"""What is doubtful about clean logs for good reason: Panda's lost packets, gaps of up to 9 ms."""


def trials(kind: Kind, logs: dict[str, list[Clean]], seed: int) -> Tally:
    """`DRAWS` draws of one kind, robots in turn."""
    rng, tally = np.random.default_rng(seed), Tally()
    robots, turn = list(logs), 0
    while tally.count < DRAWS:
        own = logs[robots[turn % len(robots)]]
        turn += 1
        clean = own[int(rng.integers(len(own)))]
        faulty = kind(clean, rng)
        if faulty is not None:
            _one(tally, clean, faulty)
    return tally


def _one(tally: Tally, clean: Clean, faulty: Faulty) -> None:
    found = diagnosis(clean, faulty.text, faulty.table)
    verdict = right_verdict(faulty, found)
    fix = verdict and right_fix(clean, faulty, found)
    tally.count += 1
    tally.verdicts += verdict
    tally.fixes += fix
    if not fix:
        sentences = [f"{f.check} {f.severity.word}: {f.says}" for f in found.findings if f.severity]
        edits = [(".".join(e.path), e.value) for e in found.edits]
        tally.missed.append(f"{clean.robot} {clean.name}: {sentences or 'nothing'} {edits}")


def false_alarms(logs: dict[str, list[Clean]]) -> tuple[Counter[str], int]:
    """How many clean logs each check calls doubtful or wrong, and how many logs there are."""
    alarms, count = Counter[str](), 0
    for clean in (c for own in logs.values() for c in own):
        count += 1
        for finding in diagnosis(clean, clean.text, clean.table).findings:
            quirk = finding.severity == 1 and (clean.robot, finding.check) in QUIRKS
            alarms[finding.check] += finding.severity > 0 and not quirk
            if finding.severity:
                sentence = f"{finding.severity.word}: {finding.says}"
                print(f"clean {clean.name}: {finding.check} {sentence}", file=sys.stderr)
    return alarms, count


def main() -> list[Claim]:
    """Per kind and overall."""
    data = data_folder()
    with tempfile.TemporaryDirectory() as folder:
        logs = {robot: real(robot, data) for robot in FITTED}
        carried = loaded_logs(logs["ur10e"][0], data)
        logs["demo arm"] = simulated(Path(folder) / "demo")
        wrong, count = false_alarms(logs)
        tallies = {
            name: trials(kind, logs, SEED + k) for k, (name, kind) in enumerate(KINDS.items())
        }
        tallies["payload of real logs"] = Tally()
        rng = np.random.default_rng(SEED)
        for k in range(DRAWS):
            name = list(LOADED)[k % len(LOADED)]
            clean = carried[name]
            faulty = real_payload(LOADED[name][1])(clean, rng)
            if faulty is not None:
                _one(tallies["payload of real logs"], clean, faulty)
    return [*_claims(tallies), _alarms(wrong, count)]


def _claims(tallies: dict[str, Tally]) -> list[Claim]:
    claims = []
    for name, tally in tallies.items():
        for line in tally.missed:
            print(f"{name}: {line[:600]}", file=sys.stderr)
        figure = f"{tally.verdicts} verdicts and {tally.fixes} fixes of {tally.count} are right"
        good = tally.fixes >= 0.95 * tally.count
        claims.append(Claim(f"injected fault: {name}", figure, "both in 95 %", good))
    count = sum(t.count for t in tallies.values())
    share = 100.0 * sum(t.fixes for t in tallies.values()) / count
    figure = f"{share:.1f} % of {count}"
    return [
        *claims,
        Claim("injected faults found and corrected", figure, "at least 95 %", share >= 95.0),
    ]


def _alarms(wrong: Counter[str], count: int) -> Claim:
    worst, times = wrong.most_common(1)[0]
    share = 100.0 * times / count
    figure = f"at most {share:.1f} % ({worst}), {wrong.total()} in all of {count} logs"
    bound = "<= 2 % per check and log"
    return Claim("false alarms on clean logs", figure, bound, share <= 2.0)


if __name__ == "__main__":
    main_of(main)
