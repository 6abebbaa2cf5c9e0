"""FMUs of a tree and a closed chain, with and without friction with memory, run by fmpy."""

import sys
import tempfile
from pathlib import Path

import fmpy
import numpy as np
from fmpy.validation import validate_fmu
from proofs.support.claims import Claim, main_of

from steelyard.base.motion import Motion
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.export.code.export_code import write_code
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.robot.robot import Robot

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from closed_chains import five_bar  # noqa: E402
from invented import tree  # noqa: E402
from moving import cycles  # noqa: E402
from weighed import identified_of  # noqa: E402

STEPS = 10_000


def wander(robot: Robot) -> Motion:
    """Samples that begin at some speed and reverse often."""
    q, dq, ddq = (0.05 * x.T for x in cycles(robot.n, 5, STEPS // 5))
    return Motion(np.arange(STEPS) / 1000.0, q + robot.assembly[: robot.n], dq, ddq)


def run(model: IdentifiedModel, path: Path, motion: Motion) -> np.ndarray:
    """Efforts along a motion, one step of the unit a sample, shape `(N, n)`."""
    described, n = fmpy.read_model_description(str(path)), model.model.robot.n
    unit = fmpy.fmi2.FMU2Slave(
        guid=described.guid,
        unzipDirectory=fmpy.extract(str(path), str(path.with_suffix(""))),
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName=path.stem,
    )
    rows = np.concatenate([motion.q, motion.dq, motion.ddq], axis=1).tolist()
    inputs, outputs = list(range(3 * n)), list(range(3 * n, 4 * n))
    unit.instantiate()
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.setReal(inputs, rows[0])
    unit.exitInitializationMode()
    found = []
    for k, row in enumerate(rows):
        unit.setReal(inputs, row)
        unit.doStep(motion.t[k], 0.001)
        found.append(unit.getReal(outputs))
    unit.terminate()
    unit.freeInstance()
    return np.array(found)


def main() -> list[Claim]:
    """Two robots, two lists of terms."""
    claims = []
    with tempfile.TemporaryDirectory() as folder:
        for make in (tree, five_bar):
            for kind, terms in (
                ("static friction", DEFAULT_TERMS),
                ("friction with memory", (*DEFAULT_TERMS, Dahl(length=2e-3))),
            ):
                model, motion = identified_of(make(), terms), wander(make())
                path = Path(folder) / f"{make.__name__}_{len(claims)}.fmu"
                write_code(model, path, "fmu")
                problems = validate_fmu(str(path))
                wanted = model.torque(motion)
                found = run(model, path, motion)
                error = float((np.abs(found - wanted) / (1.0 + np.abs(wanted))).max())
                what = f"{make.__name__}, {kind}"
                claims += [
                    Claim(f"{what}: validation", f"{len(problems)} problems", "0", not problems),
                    Claim(f"{what}: {STEPS} steps", f"{error:.1e}", "<= 1e-9", error <= 1e-9),
                ]
    return claims


if __name__ == "__main__":
    main_of(main)
