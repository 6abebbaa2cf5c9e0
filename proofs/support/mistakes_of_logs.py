"""Mistakes of what a log holds: units, signs, orders, delays, clocks, rows, noise."""

from dataclasses import replace

import numpy as np
from proofs.support.mistakes import Arm, Mistake
from proofs.support.mistakes_planted import (
    backward_difference,
    clock,
    commanded,
    efforts,
    every,
    late,
    motionless,
    reordered,
    resampled,
    rows,
    saturated,
    scaled,
    small,
    smoothed,
    two_rates,
    velocity_of_another,
    without_velocities,
)

GAIN = "(wrong|doubtful) gain|headline.*(gain or scale of the effort|gain and unit of the effort)"
LATE = r"(wrong|doubtful) effort delay|late by|delay of"

LOGS: list[Mistake] = [
    Mistake("clean", Arm.plain),
    Mistake("clean, no velocities", lambda arm: without_velocities(arm.plain())),
    Mistake("clean, 100 Hz", lambda arm: arm.plain(rate=100.0)),
    Mistake("clean, stamps since 1970", every(lambda log: replace(log, t=log.t + 1.7e9))),
    Mistake("clean, two rates", two_rates),
    Mistake("degrees", scaled("q", 180 / np.pi), "wrong position: .*deg", "velocity"),
    Mistake("degrees, one joint", scaled("q", 180 / np.pi, 0), "wrong position: .*deg", "velocity"),
    Mistake("rpm", scaled("dq", 30 / np.pi), "(wrong|doubtful) velocity: .*rpm"),
    Mistake("velocity in deg/s", scaled("dq", 180 / np.pi), "(wrong|doubtful) velocity: .*deg"),
    Mistake("effort in mNm", scaled("tau", 1e3), "wrong effort (unit|kind)"),
    Mistake("effort in kNm", scaled("tau", 1e-3), "wrong effort (unit|kind)"),
    Mistake(
        "effort in percent",
        efforts(lambda log: log.tau / [0.8, 0.8, 0.5, 0.2, 0.15, 0.08]),
        "wrong (effort kind|effort unit|gain)",
        "effort|gain",
    ),
    Mistake(
        "motor currents declared as torque",
        efforts(lambda log: log.tau / [12.0, 12.0, 9.8, 10.8, 10.8, 10.8]),
        "wrong (effort kind|effort unit|gain)",
        "effort|gain",
    ),
    Mistake(
        "torque of motors, gears 1:101",
        scaled("tau", 1 / 101.0),
        "wrong (effort kind|effort unit|gain)",
        "effort|gain",
    ),
    Mistake(
        "torque of motors, gears 1:150 to 1:257",
        efforts(lambda log: log.tau / [257.0, 254.0, 250.0, 221.0, 216.0, 150.0]),
        "wrong (effort kind|effort unit|gain)",
        "effort|gain",
    ),
    Mistake(
        "position errors over stiffnesses of 150 to 1200",
        efforts(lambda log: log.tau / [900.0, 1200.0, 800.0, 200.0, 200.0, 150.0]),
        "wrong effort kind",
        "effort|gain",
    ),
    Mistake("gear ratio, a joint twice", scaled("tau", 2.0, 1), GAIN),
    Mistake("gear ratio, a joint 0.6", scaled("tau", 0.6, 0), GAIN),
    Mistake("time in ms", clock(1e3), "wrong clock: .*ms", "velocity"),
    Mistake("time in us", clock(1e6), "wrong clock: .*us", "velocity"),
    Mistake("time in ns", clock(1e9), "wrong clock: .*ns", "velocity"),
    *(
        Mistake(f"effort sign, {k + 1}", scaled("tau", -1.0, k), "(wrong|doubtful) effort sign")
        for k in range(4)
    ),
    *(
        Mistake(f"position sign, {k + 1}", scaled("q", -1.0, k), "(wrong|doubtful) position sign")
        for k in range(3)
    ),
    Mistake(
        "position sign, first joint",
        scaled("q", -1.0, -1),
        "(wrong|doubtful) (position|effort) sig",
    ),
    Mistake("all efforts reversed", scaled("tau", -1.0), "wrong (effort sign|mounting)"),
    Mistake(
        "all positions reversed",
        scaled("q", -1.0),
        "wrong (position sign|mounting)",
        beside="wrong effort sign: .* or all positions have the opposite sign: both fit",
    ),
    Mistake("velocity sign", scaled("dq", -1.0, 0), "(wrong|doubtful) velocity"),
    Mistake("two efforts swapped", reordered([0, 2, 1, 3, 4, 5], "tau"), "wrong joint order"),
    Mistake("two positions swapped", reordered([0, 1, 4, 3, 2, 5], "q", "dq"), "wrong joint order"),
    Mistake(
        "ROS order, elbow first", reordered([2, 1, 0, 3, 4, 5], "q", "dq", "tau"), "wrong joint"
    ),
    Mistake("order of names", reordered([2, 5, 3, 1, 0, 4], "q", "dq", "tau"), "wrong joint order"),
    Mistake("order reversed", reordered([5, 4, 3, 2, 1, 0], "q", "dq", "tau"), "wrong joint order"),
    Mistake(
        "elbow first and efforts reversed",
        lambda arm: reordered([2, 1, 0, 3, 4, 5], "q", "dq", "tau")(arm).every(
            lambda log: replace(log, tau=-log.tau)
        ),
        "wrong (joint order|effort sign)",
        "joint order|effort sign",
    ),
    Mistake("velocity of another joint", every(velocity_of_another), "(wrong|doubtful) velocity"),
    *(
        Mistake(f"efforts {ms} ms late", late(ms / 1e3, "tau"), LATE)
        for ms in (4, 8, 12, 20, 50, 100)
    ),
    Mistake("efforts 20 ms early", late(-0.02, "tau"), "(wrong|doubtful) effort delay|early"),
    Mistake("velocities 50 ms late", late(0.05, "dq"), "(wrong|doubtful) velocity"),
    Mistake("velocities by backward difference", every(backward_difference), "velocity: .*differ"),
    *(
        Mistake(f"clock x {f:g}", clock(f), "(wrong|doubtful) (clock|velocity)", "clock|velocity")
        for f in (0.95, 0.5, 2.0)
    ),
    *(
        Mistake(f"clock x {f:g}, no velocities", clock(f, velocities=False), "clock|time scale")
        for f in (0.95, 0.5, 2.0)
    ),
    Mistake("clock jitters by 4 ms", rows("jitter"), "(wrong|doubtful) clock", error=1.5),
    Mistake("rows lost, stamps made uniform", every(resampled), "(wrong|doubtful) (clock|rows)"),
    Mistake("rows lost, a gap", rows("gap"), "(wrong|doubtful) (clock|rows)", error=1.5),
    Mistake("rows repeated", rows("repeated"), "(clock|rows|repeats)", error=1.5),
    Mistake("rows out of order", rows("order"), "(wrong|doubtful|refusal).*(clock|rows|backward)"),
    Mistake("rows without numbers", rows("nan"), "rows", error=1.5),
    Mistake("spikes", rows("spikes"), "(outlier|spike|rows)", error=1.5),
    Mistake(
        "wrapped at 0 and 2 pi",
        every(lambda log: replace(log, q=np.mod(log.q, 2 * np.pi))),
        "wrap",
        error=1.5,
    ),
    Mistake("efforts clipped", saturated, "(wrong|doubtful) saturation"),
    Mistake(
        "efforts in steps of 2 Nm", efforts(lambda log: np.round(log.tau / 2) * 2), "levels|step"
    ),
    Mistake("efforts low-passed at 2 Hz", every(smoothed), LATE + "|low-pass|filtered"),
    Mistake("commanded positions", commanded, LATE + "|commanded|noise-free"),
    Mistake(
        "a joint never moves", lambda arm: motionless(arm, truly=True), "excitation|not seen|moves"
    ),
    Mistake(
        "a position column is constant",
        lambda arm: motionless(arm, truly=False),
        "(wrong|doubtful) (position|excitation|rest)|does not move|never moves|constant",
    ),
    Mistake(
        "logs of 2 s", lambda arm: arm.plain(seconds=2.0), "short|identifiab|excitation|poorly"
    ),
    Mistake("motions too small", small, "excitation|identifiab|small"),
]
