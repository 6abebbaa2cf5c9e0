"""Speed beside a peer's way: least squares on MuJoCo rollouts, with derivatives by differences.

One round of the fit of an SO-101 to eight motions of 50 s: residuals and their derivatives by all
parameters. The peer rolls the exported arm out by MuJoCo (`mujoco.rollout`, in C, on two threads)
once for every parameter, as `scipy.optimize.least_squares` asks for; ours carries the derivatives
along. Both have all data in memory and everything compiled.
"""

import time

import mujoco
import numpy as np
from mujoco import rollout
from proofs.actuators.so101 import FITTED
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.actuators.actuator_model import ActuatorModel, arm_step
from steelyard.actuators.actuator_parameters import ActuatorValues, free_parameters
from steelyard.actuators.fit import Task
from steelyard.actuators.read_targets import read_targets
from steelyard.actuators.rollout import STEP
from steelyard.actuators.target_runs import windows_of
from steelyard.estimate.identified_model import Provenance
from steelyard.export.model_files.actuators_mjcf import actuators_mjcf
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import log_file

TIMED = True  # nothing else may run beside it

SECONDS, THREADS, PEER_STEP = 50.0, 2, 2e-3
PARTS = ("stiffness", "damping", "coulomb", "armature", "offset", "delay")
FASTER = 20.0


def main() -> list[Claim]:
    """Times of one round."""
    data = data_folder() / "so101"
    model = data.parent.parent / "models" / "so101" / "so101_new_calib.urdf"
    text = f'[robot]\nurdf = "{model}"\n[signals]\ntime = "time_s"\n'
    text += 'position = "q{}_rad"\ntarget = "target{}_rad"\n'
    loaded = load_robot(data / "so101.toml", text)
    assert loaded.targets is not None
    runs = []
    for name in FITTED:
        argument = log_file(f"{data / name}.parquet@0:{SECONDS:g}")
        runs += read_targets(argument, loaded.targets, loaded.robot).runs
    values = ActuatorValues.of(
        np.ones(6).tolist(), stiffness=15.0, damping=0.6, coulomb=0.3, armature=0.02, delay=0.005
    )
    step, free = arm_step(loaded.robot), free_parameters(PARTS, {}, 6)
    windows = windows_of(runs, 4.0)

    def ours(h: float) -> float:
        task = Task.of(step, windows, free, values, h=h, threads=THREADS)
        task.rolled(values, slopes=True)
        begin = time.perf_counter()
        rolled = task.rolled(values, slopes=True)
        taken = time.perf_counter() - begin
        assert all(np.isfinite(one.slopes).all() for one in rolled)
        return taken

    own, same = ours(STEP), ours(PEER_STEP)
    origin = Provenance("proof", {}, (), ())
    empty = np.zeros((0, 0))
    arm = ActuatorModel(
        *(loaded.robot, loaded.targets, values, (), empty, np.zeros(0), 1.0, np.ones(6), ()),
        *(PEER_STEP, (), (), (), (), np.zeros((6, 2)), origin),
    )
    rigid = mujoco.MjModel.from_xml_string(actuators_mjcf(arm).text)
    rigid.opt.timestep = PEER_STEP
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states, controls = [], []
    for run in runs:
        one = mujoco.MjData(rigid)
        one.qpos[:] = run.q[0]
        state = np.zeros(mujoco.mj_stateSize(rigid, full))
        mujoco.mj_getState(rigid, one, state, full)
        t = np.arange(round(SECONDS / PEER_STEP)) * PEER_STEP
        rows = np.clip(np.searchsorted(run.t - run.t[0], t, side="right") - 1, 0, None)
        states.append(state)
        controls.append(run.target[rows])
    workers = [mujoco.MjData(rigid) for _ in range(THREADS)]
    count = len(free) + 1
    begin = time.perf_counter()
    for _ in range(count):  # each with another value of one parameter
        rollout.rollout(rigid, workers, np.array(states), np.array(controls))
    peer = time.perf_counter() - begin
    what = f"{len(free)} parameters, {len(runs)} motions of {SECONDS:g} s, {THREADS} threads"
    return [
        Claim(
            f"one round, {what}: steps of {1e3 * STEP:g} ms, MuJoCo {1e3 * PEER_STEP:g} ms",
            f"{own:.2f} s, MuJoCo with differences {peer:.1f} s: {peer / own:.1f} times",
            f">= {FASTER:g} times",
            peer >= FASTER * own,
        ),
        Claim(
            f"the same, both with steps of {1e3 * PEER_STEP:g} ms",
            f"{same:.2f} s: {peer / same:.1f} times",
            "reported",
            True,
        ),
    ]


if __name__ == "__main__":
    main_of(main)
