"""Programs as vector code in LLVM's language: `lanes` samples per instruction.

Elementary functions are the Cephes approximations, to about one unit in the last place.
Sine and cosine reduce their argument by three terms of pi/2, the first of which have 33 bits, so
the reduction is exact with and without fused multiply-add, for arguments up to 1e5.

Entry `e` of a per-sample input at sample `b` is `x[e * ld + b]`; output entry `e` goes to
`y[e * ldy + b]`. `N` is a multiple of the lanes. A long program is cut into functions of at most
`CHUNK` steps, which pass values through a small workspace: compile time then grows linearly.
"""

import struct
from functools import partialmethod

from steelyard.base.arrays import by_key
from steelyard.symbolic.program_and_softening import Program, Step

MAX_ANGLE = 1e5

_SIN = (
    1.58962301576546568060e-10,
    -2.50507477628578072866e-8,
    2.75573136862245711977e-6,
    -1.98412698295895385996e-4,
    8.33333333332211858878e-3,
    -1.66666666666666307295e-1,
)
_COS = (
    -1.13585365213876817300e-11,
    2.08757008419747316778e-9,
    -2.75573141792967388112e-7,
    2.48015872888517045348e-5,
    -1.38888888888730564116e-3,
    4.16666666666665929218e-2,
)
_HALF_PI = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_EXP_P = (1.26177193074810590878e-4, 3.02994407707441961300e-2, 9.99999999999999999910e-1)
_EXP_Q = (
    3.00198505138664455042e-6,
    2.52448340349684104192e-3,
    2.27265548208155028766e-1,
    2.00000000000000000005,
)
_TANH_P = (-9.64399179425052238628e-1, -9.92877231001918586564e1, -1.61468768441708447952e3)
_TANH_Q = (1.0, 1.12811678491632931402e2, 2.23548839060100448583e3, 4.84406305325125486048e3)
_ATAN_P = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
_ATAN_Q = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)


class _Block:
    """One straight-line piece of vector code."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        self.type = f"<{lanes} x double>"
        self.lines: list[str] = []
        self.declarations: set[str] = set()
        self._count = 0

    def let(self, text: str) -> str:
        """Assign `text` to a fresh name."""
        self._count += 1
        self.lines.append(f"%t{self._count} = {text}")
        return f"%t{self._count}"

    def constant(self, value: float) -> str:
        """The same number in every lane, exact to the bit."""
        bits = struct.unpack("<Q", struct.pack("<d", value))[0]
        return "<" + ", ".join([f"double 0x{bits:016X}"] * self.lanes) + ">"

    def binary(self, operation: str, a: str, b: str) -> str:
        """`fadd`, `fsub`, `fmul` or `fdiv`; products may fuse into sums."""
        return self.let(f"{operation} contract {self.type} {a}, {b}")

    add, sub = partialmethod(binary, "fadd"), partialmethod(binary, "fsub")
    mul, div = partialmethod(binary, "fmul"), partialmethod(binary, "fdiv")

    def neg(self, a: str) -> str:
        return self.let(f"fneg {self.type} {a}")

    def intrinsic(self, name: str, *arguments: str) -> str:
        """Call one of LLVM's own functions, lane by lane."""
        full = f"@llvm.{name}.v{self.lanes}f64"
        self.declarations.add(
            f"declare {self.type} {full}({', '.join([self.type] * len(arguments))})"
        )
        return self.let(
            f"call {self.type} {full}({', '.join(f'{self.type} {a}' for a in arguments)})"
        )

    def compare(self, predicate: str, a: str, b: str) -> str:
        """Lane-wise comparison, to be used by `choose`."""
        return self.let(f"fcmp {predicate} {self.type} {a}, {b}")

    def choose(self, condition: str, yes: str, no: str) -> str:
        """Lane-wise choice."""
        return self.let(
            f"select <{self.lanes} x i1> {condition}, {self.type} {yes}, {self.type} {no}"
        )

    def polynomial(self, coefficients: tuple[float, ...], x: str) -> str:
        """Horner's scheme, highest power first."""
        value = self.constant(coefficients[0])
        for coefficient in coefficients[1:]:
            value = self.add(self.mul(value, x), self.constant(coefficient))
        return value

    def sign(self, x: str) -> str:
        zero = self.constant(0.0)
        negative = self.choose(self.compare("olt", x, zero), self.constant(-1.0), zero)
        return self.choose(self.compare("ogt", x, zero), self.constant(1.0), negative)

    def truth(self, predicate: str, a: str, b: str) -> str:
        """1 where the comparison holds, else 0."""
        return self.choose(self.compare(predicate, a, b), self.constant(1.0), self.constant(0.0))

    def sincos(self, x: str) -> tuple[str, str]:
        """Sine and cosine, for |x| <= `MAX_ANGLE`."""
        c = self.constant
        turns = self.intrinsic("rint", self.mul(x, c(0.6366197723675814)))
        r = x
        for part in _HALF_PI:
            r = self.sub(r, self.mul(turns, c(part)))
        z = self.mul(r, r)
        sine = self.add(self.mul(self.mul(self.polynomial(_SIN, z), z), r), r)
        cosine = self.add(
            self.mul(self.mul(self.polynomial(_COS, z), z), z),
            self.sub(c(1.0), self.mul(z, c(0.5))),
        )
        whole = self.intrinsic("floor", self.mul(turns, c(0.25)))
        quadrant = self.sub(turns, self.mul(whole, c(4.0)))
        odd = self.compare("oeq", self.intrinsic("fabs", self.sub(quadrant, c(2.0))), c(1.0))
        s, k = self.choose(odd, cosine, sine), self.choose(odd, sine, cosine)
        lower = self.compare("oge", quadrant, c(2.0))
        left = self.compare("olt", self.intrinsic("fabs", self.sub(quadrant, c(1.5))), c(1.0))
        return self.choose(lower, self.neg(s), s), self.choose(left, self.neg(k), k)

    def exp(self, x: str) -> str:
        c = self.constant
        clipped = self.intrinsic("minnum", self.intrinsic("maxnum", x, c(-746.0)), c(710.0))
        k = self.intrinsic("rint", self.mul(clipped, c(1.4426950408889634)))
        r = self.sub(clipped, self.mul(k, c(6.93145751953125e-1)))
        r = self.sub(r, self.mul(k, c(1.42860682030941723212e-6)))
        z = self.mul(r, r)
        p = self.mul(self.polynomial(_EXP_P, z), r)
        ratio = self.div(p, self.sub(self.polynomial(_EXP_Q, z), p))
        value = self.add(c(1.0), self.mul(c(2.0), ratio))
        half = self.intrinsic("floor", self.mul(k, c(0.5)))
        return self.mul(
            self.mul(value, self._power_of_two(half)), self._power_of_two(self.sub(k, half))
        )

    def _power_of_two(self, k: str) -> str:
        integers = f"<{self.lanes} x i64>"
        biased = self.add(k, self.constant(1023.0))
        exponent = self.let(f"fptosi {self.type} {biased} to {integers}")
        shift = "<" + ", ".join(["i64 52"] * self.lanes) + ">"
        bits = self.let(f"shl {integers} {exponent}, {shift}")
        return self.let(f"bitcast {integers} {bits} to {self.type}")

    def tanh(self, x: str) -> str:
        c = self.constant
        size = self.intrinsic("fabs", x)
        z = self.mul(x, x)
        ratio = self.div(self.polynomial(_TANH_P, z), self.polynomial(_TANH_Q, z))
        small = self.add(self.mul(self.mul(x, z), ratio), x)
        growth = self.add(self.exp(self.mul(c(2.0), size)), c(1.0))
        large = self.intrinsic("copysign", self.sub(c(1.0), self.div(c(2.0), growth)), x)
        return self.choose(self.compare("olt", size, c(0.625)), small, large)

    def atan(self, x: str) -> str:
        c = self.constant
        size = self.intrinsic("fabs", x)
        far = self.compare("ogt", size, c(2.41421356237309504880))
        middle = self.compare("ogt", size, c(0.66))
        near = self.div(self.sub(size, c(1.0)), self.add(size, c(1.0)))
        outer = self.neg(self.div(c(1.0), size))
        r = self.choose(far, outer, self.choose(middle, near, size))
        start = self.choose(
            far, c(1.5707963267948966), self.choose(middle, c(0.7853981633974483), c(0.0))
        )
        rest = self.choose(
            far,
            c(6.123233995736765886130e-17),
            self.choose(middle, c(3.061616997868382943065e-17), c(0.0)),
        )
        z = self.mul(r, r)
        ratio = self.div(self.polynomial(_ATAN_P, z), self.polynomial(_ATAN_Q, z))
        value = self.add(self.mul(self.mul(r, z), ratio), r)
        return self.intrinsic("copysign", self.add(start, self.add(value, rest)), x)


CHUNK = 800


def emit(program: Program, name: str, lanes: int) -> str:
    """LLVM code of one function that runs `program` over samples."""
    steps = len(program.steps)
    n_chunks = max(1, -(-steps // CHUNK))
    size = -(-steps // n_chunks)
    writer = _Writer(program, lanes, [use // size for use in program.last_use()])
    starts = range(0, max(steps, 1), size or 1)
    bodies = [writer.body(k, range(at, min(at + size, steps))) for k, at in enumerate(starts)]
    arguments = [f"ptr %x{i}, i64 %l{i}" for i in range(len(program.inputs))]
    passed = ", ".join([*arguments, "ptr %y, i64 %ly"])
    signature = passed.replace("ptr ", "ptr noalias ")
    functions = [
        f"define internal void @{name}_{chunk}(i64 %b, ptr noalias %ws, {signature}) noinline {{\n"
        + "\n".join(body)
        + "\nret void\n}"
        for chunk, body in enumerate(bodies)
    ]
    calls = "\n".join(
        f"call void @{name}_{chunk}(i64 %b, ptr %ws, {passed})" for chunk in range(len(bodies))
    )
    loop = f"""define void @{name}(i64 %N, {passed}) {{
entry:
%ws = alloca [{max(len(writer.slots), 1)} x <{lanes} x double>], align 64
br label %loop
loop:
%b = phi i64 [0, %entry], [%next, %loop]
{calls}
%next = add i64 %b, {lanes}
%done = icmp sge i64 %next, %N
br i1 %done, label %exit, label %loop
exit:
ret void
}}
"""
    return "\n".join([*sorted(writer.declarations), *functions, loop])


class _Writer:
    """Writes a program chunk by chunk; values that cross chunks are kept in slots."""

    def __init__(self, program: Program, lanes: int, last_chunk: list[int]) -> None:
        self.program, self.lanes, self.last_chunk = program, lanes, last_chunk
        self.entries = by_key((number, entry) for entry, number in enumerate(program.outputs))
        self.slots: dict[int, int] = {}
        self.declarations: set[str] = set()

    def body(self, chunk: int, numbers: range) -> list[str]:
        """The code of the steps of one chunk."""
        self.block = block = _Block(self.lanes)
        self.values: dict[int, str] = {}
        self.waves: dict[int, tuple[str, str]] = {}
        rows: dict[int, str] = {}
        for number in numbers:
            step = self.program.steps[number]
            if step.operation not in ("constant", "input"):
                self.values[number] = self._operation(step)
                if self.last_chunk[number] > chunk:
                    self.slots[number] = len(self.slots)
                    self._store(self.values[number], self._slot(number))
            for entry in self.entries.get(number, []):
                value = self._value(number)
                rows[entry] = (
                    block.let(f"getelementptr double, ptr {rows[entry - 1]}, i64 %ly")
                    if entry - 1 in rows
                    else self._address("%y", "%ly", entry)
                )
                self._store(value, rows[entry])
        self.declarations |= block.declarations
        return block.lines

    def _value(self, number: int) -> str:
        """The name that holds a step's value; constants, inputs and far values are fetched anew."""
        if number in self.values:
            return self.values[number]
        step = self.program.steps[number]
        if step.operation == "constant":
            return self.block.constant(step.value)
        if step.operation != "input":
            self.values[number] = self._loaded(self._slot(number))
            return self.values[number]
        array, entry = step.arguments
        if self.program.inputs[array].shared:
            self.values[number] = self._broadcast(f"%x{array}", entry)
        else:
            self.values[number] = self._loaded(self._address(f"%x{array}", f"%l{array}", entry))
        return self.values[number]

    def _operation(self, step: Step) -> str:
        block, arguments = self.block, [self._value(a) for a in step.arguments]
        match step.operation:
            case "add" | "sub" | "mul" | "div":
                return block.binary(f"f{step.operation}", *arguments)
            case "neg" | "sign" | "exp" | "tanh" | "atan":
                return str(getattr(block, step.operation)(*arguments))
            case "sin" | "cos":
                angle = step.arguments[0]
                if angle not in self.waves:
                    self.waves[angle] = block.sincos(arguments[0])
                return self.waves[angle][step.operation == "cos"]
            case "less":
                return block.truth("olt", *arguments)
            case "less_equal":
                return block.truth("ole", *arguments)
            case other:
                names = {"sqrt": "sqrt", "abs": "fabs", "minimum": "minnum", "maximum": "maxnum"}
                return block.intrinsic(names[other], *arguments)

    def _address(self, base: str, stride: str, entry: int) -> str:
        row = self.block.let(f"mul i64 {stride}, {entry}")
        index = self.block.let(f"add i64 {row}, %b")
        return self.block.let(f"getelementptr double, ptr {base}, i64 {index}")

    def _slot(self, number: int) -> str:
        return self.block.let(f"getelementptr {self.block.type}, ptr %ws, i64 {self.slots[number]}")

    def _loaded(self, place: str) -> str:
        return self.block.let(f"load {self.block.type}, ptr {place}, align 8")

    def _store(self, value: str, place: str) -> None:
        self.block.lines.append(f"store {self.block.type} {value}, ptr {place}, align 8")

    def _broadcast(self, base: str, entry: int) -> str:
        let, kind = self.block.let, self.block.type
        place = let(f"getelementptr double, ptr {base}, i64 {entry}")
        number = let(f"load double, ptr {place}, align 8")
        one = let(f"insertelement {kind} poison, double {number}, i64 0")
        mask = f"<{self.lanes} x i32> zeroinitializer"
        return let(f"shufflevector {kind} {one}, {kind} poison, {mask}")
