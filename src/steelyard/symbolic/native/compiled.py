"""A program as machine code, from the cache where possible, and the bounded linear recurrence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.symbolic.native import cache, machine, native_loops
from steelyard.symbolic.program import InputArray, Program

ENGINE = 4
"""Raised whenever emitted code changes its meaning: old cache entries are then not used."""


@dataclass(frozen=True, eq=False)
class Code:
    """Machine code of one program, and what its builder stated about it (JSON).

    `raw(N, x0, ld0, ..., y, ldy)` takes addresses and strides in numbers of doubles, and sample
    counts that are multiples of the `lanes`; `fused` and `sample` are those of `native_loops`.
    """

    about: dict[str, Any]
    n_inputs: int
    n_outputs: int
    lanes: int
    raw: Any
    fused: Any
    sample: Any

    def __call__(self, inputs: Sequence[Array], shared: Sequence[bool] | None = None) -> Array:
        """Evaluate at any number of samples: shape `(n_outputs, N)`.

        Per array `(entries, N)`, or `(entries,)` where all samples share it, as `shared` says.
        """
        flags = shared or [False] * len(inputs)
        n_samples = next(x.shape[1] for x, one in zip(inputs, flags, strict=True) if not one)
        padded = -(-n_samples // self.lanes) * self.lanes
        arrays = [
            np.ascontiguousarray(x) if one else _padded(x, padded)
            for x, one in zip(inputs, flags, strict=True)
        ]
        result = np.empty((self.n_outputs, padded))
        if n_samples:
            arguments = [
                number
                for x, one in zip(arrays, flags, strict=True)
                for number in (x.ctypes.data, 0 if one else padded)
            ]
            self.raw(padded, *arguments, result.ctypes.data, padded)
        return result[:, :n_samples]


def compiled(description: Any, build: Callable[[], tuple[Program, dict[str, Any]]]) -> Code:
    """Machine code for what `description` stands for.

    That is everything the program depends on, as JSON; its hash names the cache entry. `build`
    makes the program and states about it what callers need, if the cache has no sound entry.
    """
    lanes = machine.lanes()
    key = cache.key_of([ENGINE, machine.version(), machine.host(), lanes, description])
    entry = cache.load(key)
    if entry is None:
        program, about = build()
        about = {
            **about,
            "n_inputs": len(program.inputs),
            "n_outputs": len(program.outputs),
            "n_operations": program.n_operations,
        }
        code = machine.compile_code(_module(program, lanes))
        cache.store(key, about, code)
    else:
        about, code = entry
    library = machine.Library(code, ["program", "fused", "sample"], loops().module)
    n_inputs = int(about["n_inputs"])
    return Code(
        about=about,
        n_inputs=n_inputs,
        n_outputs=int(about["n_outputs"]),
        lanes=lanes,
        raw=library.function("program", 2 * n_inputs + 3),
        fused=library.function("fused", 2 * n_inputs + 9),
        sample=library.function("sample", 1, answers=True),
    )


def compiled_equations(
    description: Any, equations: Callable[..., Sequence[Any]], inputs: Sequence[InputArray]
) -> Code:
    """Machine code of equations over scalars, one list of them per input array; see `compiled`."""

    def build() -> tuple[Program, dict[str, Any]]:
        from steelyard.symbolic.trace import symbolic

        return symbolic(equations, inputs), {}

    return compiled(description, build)


@dataclass(frozen=True, eq=False)
class CompiledLoops:
    """The loops that do not depend on the program; see `native_loops`."""

    lanes: int
    module: machine.Library
    gram: Any
    absolute: Any
    fir: Any
    recurrence: Any


@lru_cache
def loops() -> CompiledLoops:
    """The small loops for this machine."""
    lanes = machine.lanes()
    key = cache.key_of([ENGINE, machine.version(), machine.host(), lanes, "loops"])
    entry = cache.load(key)
    if entry is None:
        pieces = (
            native_loops.gram(lanes),
            native_loops.absolute_sums(lanes),
            native_loops.decimating_fir(lanes),
            native_loops.recurrence(),
        )
        code = machine.compile_code(_joined(*pieces))
        cache.store(key, {}, code)
    else:
        code = entry[1]
    library = machine.Library(code, ["gram", "absolute", "fir", "recurrence"])
    return CompiledLoops(
        lanes=lanes,
        module=library,
        gram=library.function("gram", 6),
        absolute=library.function("absolute", 5),
        fir=library.function("fir", 9),
        recurrence=library.function("recurrence", 7),
    )


def _module(program: Program, lanes: int) -> str:
    from steelyard.symbolic.native.emit import emit

    return _joined(
        emit(program, "program", lanes),
        native_loops.fused(len(program.inputs)),
        native_loops.sample(len(program.inputs)),
    )


def _joined(*pieces: str) -> str:
    """One module; a function of LLVM's that several pieces declare is declared once."""
    lines = "\n".join(pieces).split("\n")
    declarations = dict.fromkeys(line for line in lines if line.startswith("declare"))
    return "\n".join([*declarations, *(x for x in lines if not x.startswith("declare"))])


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
