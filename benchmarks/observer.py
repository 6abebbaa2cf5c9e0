"""A step of the observer of external efforts: from Python, and exported as C."""

import subprocess
import tempfile
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
from controller_code import CLOCK, OPTIONS, ROUNDS, STATES, Best, Row, states_table, timed

from steelyard.export.code.c_code import CCode
from steelyard.export.code.controller_functions import Controller, ObserverNumbers
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.model import Model

RATE, SAMPLES = 1000.0, 100


def observer_rows(best: Best, model: Model, compiler: str | None) -> list[Row]:
    """Microseconds a sample."""
    from weighed import identified_of

    known = identified_of(model.robot, model.terms)
    rng = np.random.default_rng(0)
    t = np.arange(SAMPLES) / RATE
    q = 0.3 * np.sin(t[:, None] * np.arange(1.0, known.robot.n + 1.0))
    dq, tau = np.gradient(q, t, axis=0), rng.normal(size=q.shape)
    rows, ends = list(zip(t.tolist(), q, dq, tau, strict=True)), count(1)
    observer = known.observe(last_frame(known.robot))

    def along() -> None:
        start = next(ends) * SAMPLES / RATE
        for time, *sample in rows:
            observer.step(start + time, *sample)

    python = best(along, 100) / SAMPLES
    figure = f"{1e6 * python:.1f} us a sample"
    found = [("observer step with wrench, Python", figure, "<= 20 us", python <= 2e-5)]
    if compiler is None:
        return [*found, ("observer step, C", "gcc is not installed", "", True)]
    controller = Controller(model, known.valued.values, (), (), ObserverNumbers(8.0, None))
    with tempfile.TemporaryDirectory() as folder:
        c = _seconds_of_c(replace(controller, frames=()), Path(folder), compiler)
    return [*found, ("observer step, C", f"{1e6 * c:.2f} us a sample", "<= 2 us", c <= 2e-6)]


def _seconds_of_c(controller: Controller, folder: Path, compiler: str) -> float:
    code, n = CCode(controller, "double", ()), controller.model.robot.n
    (folder / f"{code.name}.h").write_text(code.header())
    (folder / f"{code.name}.c").write_text(code.source())
    (folder / "main.c").write_text(f"""\
#include "{code.name}.h"
#include <stdio.h>
#include <time.h>
{states_table(n)}{CLOCK}
int main(void) {{
    double external[{n}], sum = 0.0, t = 0.0;
    {code.name}_observer observer;
    const double start = now();
    {code.name}_observer_start(&observer, 8.0);
    for (int round = 0; round < {ROUNDS}; ++round)
        for (int k = 0; k < {STATES}; ++k) {{
            t += 0.001;
            {code.name}_observer_step(&observer, t, x[k], x[k] + {n}, x[k] + {2 * n}, external);
            sum += external[0];
        }}
    printf("%.12g\\n", (now() - start) / {float(ROUNDS * STATES)});
    return sum == 0.123;
}}
""")
    sources = [folder / f"{code.name}.c", folder / "main.c"]
    command = [compiler, "-std=c99", *OPTIONS, *sources, "-o", folder / "ours", "-lm"]
    subprocess.run(command, check=True)
    return timed(folder / "ours")
