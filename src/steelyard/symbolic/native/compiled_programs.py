"""A program as machine code, from the cache where possible, and the small loops around it.

Gram, |column| sums and the parallel filter work on a block of rows `y[row * ld + sample]`, in a
number of lanes. Sample counts are multiples of the lanes; callers pad with zeros. The bounded
linear recurrence goes over time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.templates import templates_of
from steelyard.symbolic.native import cache, compiler
from steelyard.symbolic.program_and_softening import (
    InputArray,
    Program,
    program_from_json,
    program_to_json,
)
from steelyard.symbolic.symbols_and_tracing import pulled_back, symbolic

TILE_ROWS = 4
TILE_COLUMNS = 3
FIR_OUTPUTS = 4


def _filled(template: str, **values: Any) -> str:
    folder = Path(__file__).parent / "templates"
    return str(templates_of(folder).get_template(template).render(values))


ENGINE = 5  # raised whenever emitted code changes its meaning: old cache entries are then not used


@dataclass(frozen=True, eq=False)
class Code:
    """Machine code of one program, and what its builder stated about it (JSON).

    `raw(N, x0, ld0, ..., y, ldy)` takes addresses and strides in numbers of doubles, and sample
    counts that are multiples of the `lanes`; `sample` is a loop beside the program.
    """

    about: dict[str, Any]
    shared: tuple[bool, ...]
    n_outputs: int
    lanes: int
    raw: Any
    sample: Any

    def __call__(self, inputs: Sequence[Array]) -> Array:
        """At `N` samples, `(n_outputs, N)`; inputs `(entries, N)`, or shared ones `(entries,)`."""
        n_samples = next(x.shape[1] for x, one in zip(inputs, self.shared, strict=True) if not one)
        padded = -(-n_samples // self.lanes) * self.lanes
        arrays = [
            np.ascontiguousarray(x) if one else _padded(x, padded)
            for x, one in zip(inputs, self.shared, strict=True)
        ]
        result = np.empty((self.n_outputs, padded))
        if n_samples:
            arguments = [
                number
                for x, one in zip(arrays, self.shared, strict=True)
                for number in (x.ctypes.data, 0 if one else padded)
            ]
            self.raw(padded, *arguments, result.ctypes.data, padded)
        return result[:, :n_samples]

    def beside(self, *names: str) -> tuple[Program, ...]:
        """Programs that its builder stated about it."""
        return tuple(program_from_json(self.about[name]) for name in names)


class SampleCall:
    """The code at one sample, on arrays that stay where they are; see `sample`.

    `call()` writes the outputs to `result`. It returns whether the sum of squares of the numbers
    `given` is below the limit, and all outputs are finite. Arrays that samples do not share are
    followed by as many spare numbers as the code has lanes beyond the first.
    """

    def __init__(
        self, code: Code, inputs: Sequence[Array], given: Array, limit: float = np.inf
    ) -> None:
        self.result = np.zeros(code.n_outputs)
        lanes = np.zeros((code.n_outputs, code.lanes))
        addresses = np.array(
            [
                code.lanes,
                *(x for array in inputs for x in (array.ctypes.data, 1)),
                *(lanes.ctypes.data, code.lanes, given.ctypes.data, len(given)),
                *(self.result.ctypes.data, code.n_outputs, np.float64(limit).view(np.int64)),
            ]
        )
        self.call: Callable[[], int] = partial(code.sample, addresses.ctypes.data)
        self._kept = (*inputs, given, lanes, addresses)


def machine_code(
    description: Any, write: Callable[[], tuple[str, dict[str, Any]]]
) -> tuple[dict[str, Any], bytes]:
    """Machine code of LLVM code and what is stated about it, from the cache where possible."""
    facts = [ENGINE, compiler.version(), compiler.host(), compiler.lanes()]
    key = cache.key_of([*facts, description])
    entry = cache.load(key)
    if entry is None:
        text, about = write()
        entry = about, compiler.compile_code(text)
        cache.store(key, *entry)
    return entry


def compiled(
    description: Any, build: Callable[[], tuple[Program, dict[str, Any]]], lanes: int | None = None
) -> Code:
    """Machine code for what `description` stands for, of as many lanes as the machine has.

    That is everything the program depends on, as JSON; its hash names the cache entry. `build`
    makes the program and states about it what callers need, also other programs, if the cache has
    no sound entry.
    """
    lanes = compiler.lanes() if lanes is None else lanes

    def write() -> tuple[str, dict[str, Any]]:
        program, about = build()
        facts = {
            "shared": [array.shared for array in program.inputs],
            "n_outputs": len(program.outputs),
            "n_operations": program.n_operations,
        }
        stated = {k: program_to_json(x) if isinstance(x, Program) else x for k, x in about.items()}
        return _module(program, lanes), {**stated, **facts}

    about, code = machine_code(description, write)
    library = compiler.Library(code, ["program", "sample"])
    return Code(
        about=about,
        shared=tuple(about["shared"]),
        n_outputs=int(about["n_outputs"]),
        lanes=lanes,
        raw=library.function("program", 2 * len(about["shared"]) + 3),
        sample=library.function("sample", 1, answers=True),
    )


def compiled_equations(
    description: Any,
    equations: Callable[..., Sequence[Any]],
    inputs: Sequence[InputArray],
    lanes: int | None = None,
    back: Sequence[int] | None = None,
) -> Code:
    """Machine code of equations over scalars, one list of them per input array; see `compiled`.

    With `back` of their reverse derivative by these input arrays, see `pulled_back`.
    """

    def build() -> tuple[Program, dict[str, Any]]:
        program = symbolic(equations, inputs)
        return program if back is None else pulled_back(program, back), {}

    return compiled([description, back], build, lanes)


@lru_cache
def loops() -> Any:
    """The small loops that do not depend on the program.

    `void gram(y, ld, N, tiles, n_tiles, sums)`, `void absolute(y, ld, N, rows, sums)`,
    `void fir(y, ldy, rows, taps, T, D, M, z, ldz)`, `void recurrence(a, b, c, y, rows, N, start)`.
    """
    lanes, arguments = compiler.lanes(), {"gram": 6, "absolute": 5, "fir": 9, "recurrence": 7}
    sizes = {"rows": TILE_ROWS, "columns": TILE_COLUMNS, "outputs": FIR_OUTPUTS}
    values = {"lanes": lanes, "t": f"<{lanes} x double>", **sizes}
    code = machine_code("loops", lambda: (_filled("loops.ll", **values), {}))[1]
    module = compiler.Library(code, list(arguments))
    return SimpleNamespace(**{name: module.function(name, n) for name, n in arguments.items()})


def _module(program: Program, lanes: int) -> str:
    from steelyard.symbolic.native.llvm_vector_code import emit

    around = _filled("around_program.ll", inputs=len(program.inputs))
    return f"{emit(program, 'program', lanes)}\n{around}"


def _padded(x: Array, n_samples: int) -> Array:
    """Samples row by row in memory, the last one repeated up to a full vector."""
    missing = n_samples - x.shape[1]
    if missing:
        x = np.concatenate([x, np.repeat(x[:, -1:], missing, axis=1)], axis=1)
    return np.ascontiguousarray(x, dtype=np.float64)


def recurrence(decay: Array, drive: Array, bound: Array, start: Array) -> tuple[Array, Array]:
    r"""$y_k = \operatorname{clip}(a_k y_{k-1} + b_k, \pm c_k)$, row by row, and its last column.

    $a, b, c$ have shape `(rows, N)`, `start` is $y_{-1}$; the next call goes on from the last.
    """
    a, b, c = (np.ascontiguousarray(x, dtype=np.float64) for x in (decay, drive, bound))
    if not a.shape == b.shape == c.shape or start.shape != a.shape[:1]:
        raise ValueError("decay, drive, bound and start differ in shape")
    result, last = np.empty_like(a), np.array(start, dtype=np.float64)
    if result.size:
        addresses = (x.ctypes.data for x in (a, b, c, result))
        loops().recurrence(*addresses, *a.shape, last.ctypes.data)
    return result, last
