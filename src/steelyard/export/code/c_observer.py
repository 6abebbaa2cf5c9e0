"""C functions that observe external efforts sample by sample, and compare them with thresholds."""

from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.external.observer import GAP, PER_PERIOD
from steelyard.estimate.external.residual_peaks import HOLD, SETTLED
from steelyard.export.code.functions import Controller, ObserverNumbers
from steelyard.symbolic.source_code import Precision, c_literal

NO_THRESHOLD = 1e30
"""Threshold of a joint that has none [Nm; N]."""


@dataclass(frozen=True, eq=False)
class ObserverCode:
    """Texts of these functions, empty where no observer is wanted.

    Attributes:
        name: Prefix of all names.
        precision: Type of all numbers but times, which are of type `double`.
        controller: The model.
    """

    name: str
    precision: Precision
    controller: Controller

    @property
    def numbers(self) -> ObserverNumbers | None:
        """Numbers of the observer."""
        return self.controller.observer

    def declarations(self) -> list[str]:
        """For the header."""
        numbers = self.numbers
        if numbers is None:
            return []
        name, real, n = self.name, self.precision, self.controller.model.robot.n
        upper = name.upper()
        passive = len(self.controller.model.robot.passive)
        memory = self.controller.n_memory
        more = f"    {real} passive[{passive}];\n" if passive else ""
        more += f"    {real} memory[{memory}];\n" if memory else ""
        gap = ""
        if passive:
            gap = " * Where the chains cannot close, step returns -2 and keeps all but the time.\n"
        contact = ""
        if numbers.thresholds is not None:
            more += f"    double visited[{n}][4];\n    double moved[{n}];\n    {real} limit[{n}];\n"
            contact = f"""
/*
 * Joints whose external effort exceeds its threshold at the last sample: 1 or 0 per joint. Returns
 * their number. Thresholds are those of {numbers.thresholds.rate:.3g} false alarms per hour, for
 * the usual bandwidth.
 */
{self._contact_signature()};
"""
        return [
            f"""\
/*
 * External efforts [Nm; N] by the generalised momentum: no accelerations are needed. Call start
 * with the bandwidth [Hz], usually {upper}_OBSERVER_BANDWIDTH, then step with every sample: its
 * time [s], positions, velocities and joint efforts. Samples have to come at ten times the
 * bandwidth or faster. step returns 0; 1 at the first sample and after a gap in time, where it
 * begins anew with external efforts of zero; -1 and changes nothing where time does not increase.
{gap} * The state belongs to the caller; several may exist.
 */
#define {upper}_OBSERVER_BANDWIDTH {c_literal(numbers.bandwidth)}

typedef struct {{
    double time, rate, longest;
    int started;
    {real} momentum[{n}];
    {real} drive[{n}];
    {real} slow[{n}];
    {real} external[{n}];
{more}}} {name}_observer;

{self._signatures()[0]};
{self._signatures()[1]};
{contact}"""
        ]

    def _signatures(self) -> tuple[str, str]:
        name, real, n = self.name, self.precision, self.controller.model.robot.n
        arrays = ", ".join(f"const {real} {x}[{n}]" for x in ("q", "dq", "tau"))
        return (
            f"void {name}_observer_start({name}_observer *observer, double bandwidth)",
            f"int {name}_observer_step({name}_observer *observer, double time, {arrays}, "
            f"{real} external[{n}])",
        )

    def _contact_signature(self) -> str:
        name, n = self.name, self.controller.model.robot.n
        return f"int {name}_observer_contact(const {name}_observer *observer, int joints[{n}])"

    def definitions(self) -> list[str]:
        """For the source."""
        numbers = self.numbers
        if numbers is None:
            return []
        start, step = self._signatures()
        return [
            *self._limits_defined(),
            f"""\
{start}
{{
    int k;
    observer->time = 0.0;
    observer->rate = {c_literal(2.0 * np.pi)} * bandwidth;
    observer->longest = {c_literal(GAP)} / ({c_literal(PER_PERIOD)} * bandwidth);
    observer->started = 0;
    for (k = 0; k < {self.controller.model.robot.n}; ++k) {{
{self._cleared()}    }}
}}

{step}
{{
{self._step_body()}}}
""",
            *self._contact_defined(),
        ]

    def _cleared(self) -> str:
        zero = c_literal(0.0, self.precision)
        arrays = ("momentum", "drive", "slow", "external")
        lines = [f"        observer->{x}[k] = {zero};\n" for x in arrays]
        if self.numbers is not None and self.numbers.thresholds is not None:
            lines += [f"        observer->visited[k][{k}] = -HUGE_VAL;\n" for k in range(4)]
            lines += ["        observer->moved[k] = -HUGE_VAL;\n"]
            lines += [f"        observer->limit[k] = {c_literal(NO_THRESHOLD, self.precision)};\n"]
        return "".join(lines)

    def _step_body(self) -> str:
        name, real, n = self.name, self.precision, self.controller.model.robot.n
        p, m = len(self.controller.model.robot.passive), self.controller.n_memory
        zero, one = (c_literal(x, real) for x in (0.0, 1.0))
        after = f", after[{m}]" if m else ""
        place = f"    {real} passive[{p}], gap;\n" if p else ""
        passive = "passive, " if p else ""
        closed = f"""\
    for (k = 0; k < {p}; ++k) {{
        passive[k] = observer->passive[k];
    }}
    gap = begins ? {name}_follow(q, passive) : {name}_close(q, passive);
    if (gap != gap) {{
        return -2;
    }}
    for (k = 0; k < {p}; ++k) {{
        observer->passive[k] = passive[k];
    }}
"""
        begun = f"        {name}_begun(q, {passive}dq, observer->memory);\n" if m else ""
        memory = ", observer->memory" if m else ""
        results = ", after" if m else ""
        stored = f"""\
    for (k = 0; k < {m}; ++k) {{
        observer->memory[k] = after[k];
    }}
"""
        thresholds = self.numbers is not None and self.numbers.thresholds is not None
        limits = f"    {name}_limits(observer, time, dq);\n" if thresholds else ""
        return f"""\
    const double since = time - observer->time;
    const int begins = !observer->started || since > observer->longest;
    {real} scalars[3], momentum[{n}], drive[{n}], slow[{n}], next[{n}]{after};
{place}    int k;
    if (observer->started && !(since > 0.0)) {{
        return -1;
    }}
{closed if p else ""}    scalars[0] = begins ? {one} : ({real})exp(-observer->rate * since);
    scalars[1] = begins ? {zero} : ({real})(1.0 / since);
    scalars[2] = ({real})observer->rate;
    if (begins) {{
{begun}        for (k = 0; k < {n}; ++k) {{
            observer->slow[k] = dq[k];
            observer->external[k] = {zero};
        }}
    }}
    {name}_observed(q, {passive}dq, tau, scalars, observer->momentum, observer->drive,
        observer->slow, observer->external{memory}, momentum, drive, slow, next{results});
    for (k = 0; k < {n}; ++k) {{
        observer->momentum[k] = momentum[k];
        observer->drive[k] = drive[k];
        observer->slow[k] = slow[k];
        observer->external[k] = external[k] = next[k];
    }}
{stored if m else ""}    observer->time = time;
    observer->started = 1;
{limits}    return begins;
"""

    def _limits_defined(self) -> list[str]:
        """Thresholds at a sample, see `ThresholdStepper`."""
        numbers, real = self.numbers, self.precision
        if numbers is None or numbers.thresholds is None:
            return []
        known, n, end = numbers.thresholds, self.controller.model.robot.n, "f" * (real == "float")
        limits = np.where(np.isnan(known.limits), NO_THRESHOLD, known.limits)
        return [
            f"""\
/* Thresholds at a sample: a joint is in the slowest range of the last {HOLD:g} s. */
static void {self.name}_limits({self.name}_observer *observer, double time, const {real} dq[{n}])
{{
    static const {real} edges[{n}][3] = {{
{self._rows(known.edges)}
    }};
    static const {real} limits[{n}][5] = {{
{self._rows(limits)}
    }};
    int j, range;
    for (j = 0; j < {n}; ++j) {{
        const {real} speed = fabs{end}(dq[j]);
        const int now = (speed > edges[j][0]) + (speed > edges[j][1]) + (speed > edges[j][2]);
        observer->visited[j][now] = time;
        if (now > 0) {{
            observer->moved[j] = time;
        }}
        range = 0;
        while (range < now && !(observer->visited[j][range] >= time - {c_literal(HOLD)})) {{
            ++range;
        }}
        if (range > 0 || time - observer->moved[j] <= {c_literal(SETTLED)}) {{
            ++range;
        }}
        observer->limit[j] = limits[j][range];
    }}
}}
"""
        ]

    def _rows(self, table: Array) -> str:
        rows = (", ".join(c_literal(float(x), self.precision) for x in row) for row in table)
        return ",\n".join(f"        {{{row}}}" for row in rows)

    def _contact_defined(self) -> list[str]:
        if self.numbers is None or self.numbers.thresholds is None:
            return []
        n, end = self.controller.model.robot.n, "f" * (self.precision == "float")
        return [
            f"""\
{self._contact_signature()}
{{
    int k, count = 0;
    for (k = 0; k < {n}; ++k) {{
        joints[k] = fabs{end}(observer->external[k]) > observer->limit[k];
        count += joints[k];
    }}
    return count;
}}
"""
        ]
