"""Emit a program as vector code: `void name(i64 N, ptr x0, i64 ld0, ..., ptr y, i64 ldy)`.

Entry `e` of a per-sample input at sample `b` is `x[e * ld + b]`; output entry `e` goes to
`y[e * ldy + b]`. `N` is a multiple of the lanes. A long program is cut into functions of at most
`CHUNK` steps, which pass values through a small workspace: compile time then grows linearly.
"""

from dataclasses import dataclass, field

from steelyard.kernel.native.vector_ir import Block
from steelyard.kernel.program.program import Program

CHUNK = 800


@dataclass
class _Emission:
    """What is known while a program is written: where values that cross chunks are kept."""

    program: Program
    lanes: int
    steps_of: list[range]
    last_chunk: list[int]
    entries: dict[int, list[int]]
    slots: dict[int, int] = field(default_factory=dict)
    declarations: set[str] = field(default_factory=set)


def emit(program: Program, name: str, lanes: int) -> str:
    """LLVM code of one function that runs `program` over samples."""
    steps = len(program.steps)
    n_chunks = max(1, -(-steps // CHUNK))
    size = -(-steps // n_chunks)
    steps_of = [range(k * size, min((k + 1) * size, steps)) for k in range(n_chunks)]
    last_chunk = [use // size for use in program.last_use()]
    entries: dict[int, list[int]] = {}
    for entry, number in enumerate(program.outputs):
        entries.setdefault(number, []).append(entry)
    emission = _Emission(program, lanes, steps_of, last_chunk, entries)
    bodies = [_chunk(emission, chunk) for chunk in range(n_chunks)]
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
        f"call void @{name}_{chunk}(i64 %b, ptr %ws, {passed})" for chunk in range(n_chunks)
    )
    loop = f"""define void @{name}(i64 %N, {signature}) {{
entry:
%ws = alloca [{max(len(emission.slots), 1)} x <{lanes} x double>], align 64
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
    return "\n".join([*sorted(emission.declarations), *functions, loop])


def _chunk(emission: _Emission, chunk: int) -> list[str]:
    block = Block(emission.lanes)
    values: dict[int, str] = {}
    waves: dict[int, tuple[str, str]] = {}
    rows: dict[int, str] = {}
    for number in emission.steps_of[chunk]:
        step = emission.program.steps[number]
        if step.operation not in ("constant", "input"):
            arguments = [_value(emission, block, values, a) for a in step.arguments]
            values[number] = _operation(block, step.operation, step.arguments, arguments, waves)
            if emission.last_chunk[number] > chunk:
                slot = emission.slots[number] = len(emission.slots)
                _store(block, values[number], _slot(block, slot))
        for entry in emission.entries.get(number, []):
            value = _value(emission, block, values, number)
            place = (
                block.let(f"getelementptr double, ptr {rows[entry - 1]}, i64 %ly")
                if entry - 1 in rows
                else _address(block, "%y", "%ly", entry)
            )
            rows[entry] = place
            _store(block, value, place)
    emission.declarations |= block.declarations
    return block.lines


def _value(emission: _Emission, block: Block, values: dict[int, str], number: int) -> str:
    """The name that holds a step's value; constants, inputs and far values are fetched anew."""
    if number in values:
        return values[number]
    step = emission.program.steps[number]
    if step.operation == "constant":
        return block.constant(step.value)
    if step.operation == "input":
        array, entry = step.arguments
        if emission.program.inputs[array].shared:
            values[number] = _broadcast(block, f"%x{array}", entry)
        else:
            place = _address(block, f"%x{array}", f"%l{array}", entry)
            values[number] = block.let(f"load {block.type}, ptr {place}, align 8")
    else:
        place = _slot(block, emission.slots[number])
        values[number] = block.let(f"load {block.type}, ptr {place}, align 8")
    return values[number]


def _operation(
    block: Block,
    operation: str,
    numbers: tuple[int, ...],
    arguments: list[str],
    waves: dict[int, tuple[str, str]],
) -> str:
    match operation:
        case "add" | "sub" | "mul" | "div":
            return block.binary(f"f{operation}", *arguments)
        case "neg" | "sign" | "exp" | "tanh" | "atan":
            result: str = getattr(block, operation)(*arguments)
            return result
        case "sin" | "cos":
            if numbers[0] not in waves:
                waves[numbers[0]] = block.sincos(arguments[0])
            return waves[numbers[0]][operation == "cos"]
        case "less":
            return block.truth("olt", *arguments)
        case "less_equal":
            return block.truth("ole", *arguments)
        case _:
            intrinsics = {"sqrt": "sqrt", "abs": "fabs", "minimum": "minnum", "maximum": "maxnum"}
            return block.intrinsic(intrinsics[operation], *arguments)


def _address(block: Block, base: str, stride: str, entry: int) -> str:
    row = block.let(f"mul i64 {stride}, {entry}")
    index = block.let(f"add i64 {row}, %b")
    return block.let(f"getelementptr double, ptr {base}, i64 {index}")


def _store(block: Block, value: str, place: str) -> None:
    block.lines.append(f"store {block.type} {value}, ptr {place}, align 8")


def _slot(block: Block, slot: int) -> str:
    return block.let(f"getelementptr {block.type}, ptr %ws, i64 {slot}")


def _broadcast(block: Block, base: str, entry: int) -> str:
    place = block.let(f"getelementptr double, ptr {base}, i64 {entry}")
    number = block.let(f"load double, ptr {place}, align 8")
    one = block.let(f"insertelement {block.type} poison, double {number}, i64 0")
    mask = f"<{block.lanes} x i32> zeroinitializer"
    return block.let(f"shufflevector {block.type} {one}, {block.type} poison, {mask}")
