"""Words and tables about actuators: how far off motion is, what the law has, and its values."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.actuators.actuator_model import ActuatorModel, ActuatorParameter
from steelyard.actuators.actuator_parameters import KINDS, Kind
from steelyard.actuators.choice import NEEDED_NATS, Rung
from steelyard.actuators.logged_efforts import masses_differ
from steelyard.actuators.open_loop import AFTER, OpenLoop, tool_body
from steelyard.base.arrays import Z95, Array
from steelyard.report.tables import PlainTable, Row
from steelyard.report.words import NONE, Level, count, first_names, significant

GOOD, FAIR = 0.35, 0.8
"""Mean error over that of "position = target", up to which a model is good, or fair."""
WORST_GOOD, WORST_FAIR = 0.7, 1.2
"""The same of the worst joint."""
RARE = 6.0  # error of a whole log over the usual residual, above which long stretches are missed
LEAST_WIDER = 1.05  # factor of intervals, from which on it is told
STILL = 1e-4  # error of "position = target" of a joint that does not move [rad; m]


@dataclass(frozen=True)
class ActuatorVerdict:
    """The headline: how far off motion is, and what that rests on."""

    level: Level
    line: str
    share: float | None
    unseen: bool

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "level": self.level,
            "line": self.line,
            "share_of_position_is_target": self.share,
            "unseen": self.unseen,
        }


def together(found: Sequence[OpenLoop], name: str = "rms") -> Array:
    """Root mean square over logs of an error by joint, by their lengths, `(n,)`."""
    weight = np.array([one.seconds for one in found])
    squares = np.array([getattr(one, name) ** 2 for one in found])
    return np.asarray(np.sqrt(weight @ squares / weight.sum()))


def limit_words(model: ActuatorModel, logs: Sequence[OpenLoop]) -> tuple[str, ...]:
    """Joints whose motion leaves the limits of the model file: their sign or zero is wrong."""
    q = np.concatenate([one.q for one in logs])
    return tuple(
        f"sign or zero cannot be right: with them {joint} moves over {words}; {remedy_of(model)}"
        for joint, words in model.outside_limits(q).items()
    )


def remedy_of(model: ActuatorModel) -> str:
    """What to do about motion beyond the limits of joints."""
    s = model.signals
    if all(x is None for x in (*s.signs, *s.zeros)):
        return "state position_sign and position_offset"
    return "compare the stated position_sign and position_offset with the arm, as `check` does"


def open_words(model: ActuatorModel) -> tuple[str, ...]:
    """What is assumed of joints that the fitted logs do not show."""
    found = []
    if model.still:
        still = ", ".join(model.still)
        found.append(f"{still}: no motion in the fitted logs, nothing of it is identified")
    if model.open_signs:
        signs = dict(zip(model.joints, model.values.signs, strict=True))
        some = ", ".join(f"{joint} {signs[joint]:+g}" for joint in model.open_signs)
        found.append(
            "signs of the log against the model file are not decided by the fitted logs: assumed "
            f"are {some}. Errors of joints are the same with others; the posture of the arm, its "
            "tool and torques are not: compare the replay in the report with your arm, and state "
            "position_sign"
        )
    return tuple(found)


def missed_words(model: ActuatorModel, logs: Sequence[OpenLoop]) -> tuple[str, ...]:
    """Joints whose error in some log is far above what is usual: something is not described."""
    by: dict[str, list[str]] = {}
    for one in logs:
        bad = (one.rms > RARE * model.scale) & (one.rms > 0.2 * one.target_rms)
        for j in np.flatnonzero(bad & (one.target_rms > STILL)):
            by.setdefault(model.joints[j], []).append(one.log)
    if not by:
        return ()
    listed = "; ".join(f"{joint} in {first_names(names, 3)}" for joint, names in by.items())
    return (
        "stretches that the model does not describe, such as contact, a stop, a servo that is off, "
        f"or links whose masses are off: {listed}",
    )


def interval_words(model: ActuatorModel) -> str:
    """What the intervals rest on."""
    if model.wider is None:
        found = "no value shows in both halves of the motions, so that nothing tests the intervals"
    elif model.wider < LEAST_WIDER:
        found = (
            "fits to two halves of the motions agree in 95 % of their values within the intervals"
        )
    else:
        found = (
            f"the 95 % intervals are widened by a factor of {model.wider:.2g}, so that fits to two "
            "halves of the motions agree in 95 % of their values"
        )
    masses = "centres and inertias" if model.masses_searched else "masses"
    return (
        f"{found}. They do not cover {masses} of links that are wrong, what the law lacks in all "
        "motions, or that other logs may ask for another law"
    )


def weight_words(model: ActuatorModel) -> tuple[str, ...]:
    """Links that logged efforts ask for, and that are far from those of the model file."""
    factors = dict(zip(model.joints, model.values["mass_factor"].tolist(), strict=True))
    if not model.measured or not (far := {j: x for j, x in factors.items() if masses_differ(x)}):
        return ()
    listed = ", ".join(f"{joint} {x:.2g}" for joint, x in far.items())
    agree = ", ".join(
        f"{one.joint} {significant(one.by_masses)}" for one in model.efforts if one.by_masses
    )
    return (
        "with the gains that are stated, logged efforts ask for links that are so many times as "
        f"heavy as those of the model file: {listed}; compare gain, unit and columns of efforts, "
        f"and the masses, with the arm (gains that agree with the masses: {agree})",
    )


def effort_words(model: ActuatorModel) -> tuple[str, ...]:
    """Logged efforts that do not fit what is stated, or show nothing, and what was assumed."""
    return tuple(
        f"logged efforts of {one.joint} {one.reason}" for one in model.efforts if one.reason
    )


def assumed_words(model: ActuatorModel) -> tuple[str, ...]:
    """Joints without a scale of their own."""
    if not model.assumed:
        return ()
    return (
        "neither gravity nor the inertia of links shows the stiffness of "
        f"{', '.join(model.assumed)}: it is assumed to be about the median of the others', and "
        "gives the other values of these joints their scale (intervals allow for how uncertain "
        "that is); "
        "state it if it is known",
    )


def verdict_of(model: ActuatorModel, found: Sequence[OpenLoop], where: str) -> ActuatorVerdict:
    """Errors of all joints against those of "position = target"."""
    rms, target = together(found), together(found, "target_rms")
    moves = target > STILL
    share = float(np.mean(rms[moves] / target[moves])) if moves.any() else None
    level: Level = "none"
    if share is not None:
        most = float(np.max(rms[moves] / target[moves]))
        good, fair = share <= GOOD and most <= WORST_GOOD, share <= FAIR and most <= WORST_FAIR
        level = "good" if good else "fair" if fair else "poor"
        if limit_words(model, found):
            level = "poor"
    worst = int(np.argmax(np.where(moves, rms, -1.0)))
    mean = f"{_size(model, rms.mean())} mean over {count(len(rms), 'joint')}, "
    if len({c.kind for c in model.robot.coordinates}) > 1:
        mean = ""
    line = (
        f"open loop {where}: {mean}{_size(model, rms[worst], worst)} of {model.joints[worst]}, "
        "the worst"
    )
    if share is not None:
        line += f'; {share:.0%} of the error of "position = target"'
        if most > WORST_GOOD:
            j = int(np.argmax(np.where(moves, rms / np.maximum(target, 1e-12), -1.0)))
            line += f", {most:.0%} for {model.joints[j]}"
    return ActuatorVerdict(level, line, share, True)


def _size(model: ActuatorModel, error: float, joint: int = 0) -> str:
    unit = "mrad" if model.robot.coordinates[joint].kind == "revolute" else "mm"
    return f"{significant(1e3 * float(error))} {unit}"


def scale_words(model: ActuatorModel) -> str:
    """Where stiffness and friction have their scale from, and what that means."""
    words = scale_source(model)
    if model.measured or "stiffness" in model.stated:
        return words
    words += ". If all masses are off by 10 %, so are they; ratios and the error above are not"
    if not model.masses_searched:
        words += '. Single links that are off raise the error: [actuator] mass_factor = "identify"'
    return words


def scale_source(model: ActuatorModel) -> str:
    """Where torques have their scale from, and the voltage that values are for."""
    words = "torques, stiffness and inertia have the scale of the masses in the model file"
    if model.measured:
        words = (
            f"torques of {', '.join(model.measured)} have the scale of the logged efforts, with "
            "the gains that are stated; masses of links are identified beside them"
        )
        if "stiffness" in model.stated:
            words += "; others have that of the stiffness that is stated"
    elif "stiffness" in model.stated:
        words = "torques have the scale of the stiffness that is stated"
    if model.signals.supply:
        nominal = model.signals.nominal
        words += f"; stiffness and torque limits are those at a supply of {nominal:g}"
    return words


CLAIM = (
    "Positions are predicted from the targets alone, from the first row on: root mean squares. "
    "Drift: the error some time after a start from a measured state, over many such starts."
)


def errors_table(model: ActuatorModel, found: Sequence[OpenLoop]) -> PlainTable:
    """Errors by joint, all logs together."""
    rms, target = together(found), together(found, "target_rms")
    rows = []
    for j, joint in enumerate(model.joints):
        drifts = [_drift(found, after, j) for after in AFTER]
        cells = [milli(rms[j]), milli(target[j]), *drifts]
        rows.append(Row((joint, *cells)))
    weight = np.array([one.seconds for one in found])
    tool, meant = (
        float(np.sqrt(weight @ np.array([getattr(one, name) ** 2 for one in found]) / weight.sum()))
        for name in ("tool", "target_tool")
    )
    last = [_drift(found, after, None) for after in AFTER]
    rows.append(Row(("tool [mm]", milli(tool), milli(meant), *last), total=True))
    name = model.robot.bodies[tool_body(model.robot)].name
    units = "mrad" if all(c.kind == "revolute" for c in model.robot.coordinates) else "mrad; mm"
    headings = ("joint", f"rms [{units}]", "position = target")
    words = f'The tool is the origin of "{name}".'
    return PlainTable("", words, (*headings, *(f"drift {x:g} s" for x in AFTER)), rows)


def milli(x: float) -> str:
    """A thousandth is the unit; less than a thousandth of it is nothing."""
    return significant(1e3 * float(x)) if abs(x) >= 1e-6 else "0"


def _drift(found: Sequence[OpenLoop], after: float, joint: int | None) -> str:
    known = [
        (one.seconds, x.tool if joint is None else float(x.rms[joint]))
        for one in found
        for x in one.drift
        if x.after == after
    ]
    if not known:
        return NONE
    weight, value = np.array(known).T
    return milli(float(np.sqrt(weight @ value**2 / weight.sum())))


def logs_table(
    model: ActuatorModel, found: Sequence[OpenLoop], fitted: Sequence[str] = ()
) -> PlainTable:
    """Errors of each log, joint by joint."""
    rows = [
        Row(
            (
                one.log + " (fitted)" * (one.log in fitted),
                *(milli(x) for x in one.rms),
                milli(one.tool),
            )
        )
        for one in found
    ]
    words = "Errors in mrad (mm of sliding joints)."
    return PlainTable("By log", words, ("log", *model.joints, "tool [mm]"), rows)


def fitted_table(fitted: Sequence[OpenLoop]) -> PlainTable:
    """The logs that the parameters are from."""
    rows = [Row((one.log, significant(one.seconds))) for one in fitted]
    return PlainTable("", "", ("log", "length [s]"), rows)


TABLES = (
    ("stiffness", "integral", "damping", "back_emf", "armature", "torque_limit", "dead_band"),
    ("coulomb", "stribeck", "stribeck_speed", "load_friction"),
    ("offset", "zero", "delay", "mass_factor"),
)
"""Parameters of one table each: controller and motor, dry friction, the log and the links."""


def parameters_tables(model: ActuatorModel) -> list[PlainTable]:
    """A row per joint, a column per parameter of the law, with 95 % intervals."""
    used = [k for k in KINDS if any(p.name == k.name and p.interval for p in model.parameters)]
    used += [k for k in KINDS if k not in used and k.name in model.stated]
    shared = {p.name for p in model.parameters if p.joint == "all"}
    own = [k for k in used if k.name not in shared]
    common = [p for p in model.parameters if p.joint == "all" and p.interval]
    words = "".join(f" The {p.name} of all joints is {_value(p)} {p.unit}." for p in common)
    told = f"95 % intervals in brackets; ? where the logs do not show the value.{words}"
    return [
        _by_joint(model, some, _value, "{} [{}]", told if names is TABLES[0] else "")
        for names in TABLES
        if (some := [k for k in own if k.name in names])
    ]


def _by_joint(
    model: ActuatorModel,
    kinds: Sequence[Kind],
    cell: Callable[[ActuatorParameter], str],
    heading: str,
    words: str,
) -> PlainTable:
    """A column for each of these parameters."""
    rows = []
    for joint in model.joints:
        mine = {p.name: p for p in model.parameters if p.joint == joint}
        rows.append(Row((joint, *(cell(mine[k.name]) for k in kinds))))
    names = (heading.format(k.name.replace("_", " "), k.unit).removesuffix(" 1") for k in kinds)
    return PlainTable("", words, ("joint", *names), rows)


def _value(one: ActuatorParameter) -> str:
    if one.interval is None:
        told = one.status in ("stated", "assumed")
        return f"{significant(one.value)} ({one.status})" if told else NONE
    low, high = one.interval
    mark = {"not identifiable": " ?", "assumed": " (assumed)"}.get(one.status, "")
    return f"{significant(one.value)} [{significant(low)}, {significant(high)}]{mark}"


def efforts_table(model: ActuatorModel) -> PlainTable:
    """Torque per logged effort, by joint."""
    rows = []
    for one in model.efforts:
        value = NONE if one.value is None else significant(one.value)
        if one.interval:
            low, high = (significant(x) for x in one.interval)
            value = f"{value} [{low}, {high}]"
        other = NONE if one.by_masses is None else significant(one.by_masses)
        follows = NONE if one.follows is None else f"{one.follows:.3f}"
        rows.append(Row((one.joint, value, one.unit, one.status, other, follows)))
    words = (
        "Torque of the joint per logged effort, 95 % intervals in brackets: a gain that is "
        "identified has the scale of the other values. By masses: the gain with which torques have "
        "the scale of the masses in the model file. Correlation: of efforts with the torque of the "
        "controller, without what speed and friction explain."
    )
    names = ("joint", "gain", "unit", "", "by masses", "correlation")
    return PlainTable("Logged efforts", words, names, rows, (0, 2, 3))


BRIEF = (
    "±: half of the 95 % interval; ?: a standard deviation above about a third, or mostly what is "
    "assumed before any log."
)


def brief_tables(model: ActuatorModel) -> list[PlainTable]:
    """The parameters of the law in few columns, for the terminal: `?` for wide intervals."""
    used = [
        k
        for k in KINDS
        if k.positive
        and any(p.name == k.name and p.status != "not in the law" for p in model.parameters)
    ]
    return [
        _by_joint(model, some, _brief, "{} {}", "")
        for names in TABLES
        if (some := [k for k in used if k.name in names])
    ]


def _brief(one: ActuatorParameter) -> str:
    if one.status == "assumed":
        return f"{significant(one.value)} assumed"
    if one.interval is None:
        return significant(one.value) if one.status == "stated" else NONE
    if one.status == "not identifiable":
        return f"{significant(one.value, 2)} ?"
    half = 50.0 * (one.interval[1] - one.interval[0]) / one.value
    return (
        f"{significant(one.value)} ±{half:.0f}%"
        if half >= 1.0
        else f"{significant(one.value)} ±<1%"
    )


RATIOS = (
    ("coulomb", "Coulomb friction over stiffness [mrad]"),
    ("damping", "damping over stiffness [ms]"),
    ("back_emf", "back-EMF over stiffness [ms]"),
    ("armature", "armature over stiffness [10⁻³ s²]"),
)


def ratios_table(model: ActuatorModel) -> PlainTable:
    """What positions alone determine: parameters over the stiffness."""
    rows, searched = [], {one.name for one in model.free}
    shown = [(name, heading) for name, heading in RATIOS if name in searched]
    for j, joint in enumerate(model.joints):
        cells = []
        for name, _ in shown:
            found = model.ratio(name, j)
            if found is None:
                cells.append(NONE)
                continue
            value, std = found
            low, high = value * np.exp(-Z95 * std), value * np.exp(Z95 * std)
            cells.append(f"{milli(value)} [{milli(low)}, {milli(high)}]")
        rows.append(Row((joint, *cells)))
    words = "These need no masses; 95 % intervals in brackets, for the law that was chosen."
    return PlainTable("", words, ("joint", *(heading for _, heading in shown)), rows)


def law_lines(model: ActuatorModel, law: Sequence[Rung]) -> list[str]:
    """What the law has, what of the usual one it does without, and what was tried in vain."""
    parts = [
        p for p in law_parts(law) if p not in ("stiffness", "damping", "offset", "zero", "delay")
    ]
    lines = [f"law    position controller with {', '.join(_words(p) for p in parts)}"]
    lines += [_delay_line(p) for p in model.parameters if p.name == "delay"]
    added = dict.fromkeys(r.tried[2:] for r in law if r.tried.startswith("+"))
    vain = [_words(part) for part in added if part not in law_parts(law)]
    if vain:
        lines.append(f"tried on left-out motion, and not needed: {', '.join(vain)}")
    return lines


def _delay_line(delay: ActuatorParameter) -> str:
    of = f"of {'all joints' if delay.joint == 'all' else delay.joint}"
    if delay.interval is not None:
        low, high = (1e3 * x for x in delay.interval)
        size = f"{significant(1e3 * delay.value)} [{significant(low, 2)}, {significant(high, 2)}]"
        return f"delay  {size} ms, {of}"
    if delay.status in ("stated", "assumed"):
        return f"delay  {significant(1e3 * delay.value)} ms {of}, {delay.status}"
    if delay.joint != "all":
        return f"delay  none {of}"
    return "delay  none: motion that was left out is predicted as well without one"


def _words(part: str) -> str:
    """A part of the law in words."""
    return {
        "coulomb": "dry friction",
        "armature": "rotor inertia",
        "stribeck": "friction that falls with speed (Stribeck)",
        "load_friction": "friction that grows with the load",
        "back_emf": "a torque limit that falls with speed (back-EMF)",
        "delays": "a delay of each joint",
        "torque_limit": "a torque limit",
        "dead_band": "a dead band",
        "integral": "an integral gain",
        "mass_factor": "factors on the masses of links",
    }.get(part, part.replace("_", " "))


def law_parts(law: Sequence[Rung]) -> tuple[str, ...]:
    """Parameters of the law that was chosen."""
    return next(r.parts for r in reversed(law) if r.kept)


USUAL_LAW = "the usual law: controller, rotor inertia, dry friction, one delay"


def law_table(law: Sequence[Rung]) -> PlainTable:
    """Laws that were tried."""
    rows, seen = [], set[str]()
    for r in law:
        sign, part = r.tried[:1], _words(r.tried[2:])
        name = f"with {part}" if sign == "+" else f"without {part}" if sign == "-" else USUAL_LAW
        again = ", again" if r.tried in seen else ""
        seen.add(r.tried)
        gain = f"{r.gain if sign == '+' else -r.gain:+.3g}" if sign in ("+", "-") else NONE
        rows.append(Row((name + again, milli(r.error), gain, "taken" if r.kept else "not taken")))
    words = (
        "Each is fitted without about a quarter of the motion, and judged by the residuals of that "
        "quarter: geometric mean of their usual and their root mean square size. The gain is the "
        "log-likelihood of that quarter over that of the law that was taken last above, allowing "
        "for residuals that follow each other; a window counts for a bounded share. A part is "
        f"added if it gains more than {NEEDED_NATS:g}, and left out if that loses less."
    )
    return PlainTable("", words, ("law", "left-out error [mrad]", "gain [nats]", ""), rows, (0, 3))
