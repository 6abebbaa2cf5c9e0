"""The small loops around a traced program: Gram, |column| sums, parallel filter, recurrence.

All but the recurrence work on a block of rows `y[row * ld + sample]`, in a number of lanes. Sample
counts are multiples of the lanes; callers pad with zeros.
"""

from pathlib import Path
from typing import Any

TILE_ROWS = 4
TILE_COLUMNS = 3
FIR_OUTPUTS = 4


def loops_code(lanes: int) -> str:
    """The loops that do not depend on the program, as LLVM code.

    `void gram(y, ld, N, tiles, n_tiles, sums)`, `void absolute(y, ld, N, rows, sums)`,
    `void fir(y, ldy, rows, taps, T, D, M, z, ldz)`, `void recurrence(a, b, c, y, rows, N, start)`.
    """
    sizes = {"rows": TILE_ROWS, "columns": TILE_COLUMNS, "outputs": FIR_OUTPUTS}
    return _filled("loops.ll", lanes=lanes, t=f"<{lanes} x double>", **sizes)


def around_program(inputs: int) -> str:
    """Loops that call a program of some input arrays, as LLVM code.

    `void fused(N, x0, ld0, ..., B, y, ldy, tiles, n_tiles, sums, rows, absolute)` and
    `i64 sample(arguments)`.
    """
    return _filled("around_program.ll", inputs=inputs)


def _filled(template: str, **values: Any) -> str:
    from steelyard.report.page import templates_of

    folder = Path(__file__).parent / "templates"
    return str(templates_of(folder).get_template(template).render(values))
