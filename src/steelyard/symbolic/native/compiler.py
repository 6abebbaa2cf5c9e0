"""This machine: its vector lanes, machine code for it, and how to call that code.

The only file of the package that imports llvmlite.
"""

import ctypes
import itertools
import threading
from collections.abc import Sequence
from functools import cache
from typing import Any

_LOCK = threading.Lock()
_NUMBER = itertools.count()


@cache
def host() -> tuple[str, str]:
    """Name and features of the processor; both decide which machine code is right."""
    binding = _llvm()
    return binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()


@cache
def version() -> str:
    """Version of the code generator."""
    import llvmlite

    return f"llvmlite {llvmlite.__version__}"


@cache
def lanes() -> int:
    """Samples per vector instruction."""
    features = host()[1].split(",")
    if "+avx512f" in features:
        return 8
    return 4 if "+avx" in features else 2


def compile_code(text: str) -> bytes:
    """Machine code (an object file) of LLVM code, for this machine."""
    with _LOCK:
        return bytes(_target(1).emit_object(_llvm().parse_assembly(text)))


class Library:
    """Loaded machine code, by a name among all that is loaded."""

    def __init__(self, code: bytes, symbols: Sequence[str]) -> None:
        """Load an object file; `symbols` are functions to be called from Python."""
        with _LOCK:
            builder = _llvm().JITLibraryBuilder().add_object_img(code).add_current_process()
            for symbol in symbols:
                builder = builder.export_symbol(symbol)
            self._tracker = builder.link(_compiler(), f"steelyard{next(_NUMBER)}")
            self._addresses = {symbol: int(self._tracker[symbol]) for symbol in symbols}

    def function(self, symbol: str, n_arguments: int, answers: bool = False) -> Any:
        """A callable of 64-bit integers and addresses.

        If it answers, it returns an integer and keeps the interpreter's lock, which takes longer to
        give away than a function of a microsecond. Others run beside other threads.
        """
        arguments = [ctypes.c_int64] * n_arguments
        prototype = (
            ctypes.PYFUNCTYPE(ctypes.c_int64, *arguments)
            if answers
            else ctypes.CFUNCTYPE(None, *arguments)
        )
        function = prototype(self._addresses[symbol])
        function.loaded_from = self  # type: ignore[attr-defined]
        return function


@cache
def _llvm() -> Any:
    import llvmlite.binding as binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding


def _target(optimisation: int) -> Any:
    name, features = host()
    target = _llvm().Target.from_default_triple()
    return target.create_target_machine(cpu=name, features=features, opt=optimisation, jit=True)


@cache
def _compiler() -> Any:
    return _llvm().create_lljit_compiler(_target(0))
