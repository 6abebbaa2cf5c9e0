"""The small loops around a traced program: Gram, |column| sums, parallel filter, recurrence.

The first three work on a block of rows `y[row * ld + sample]` and are emitted for a number of
lanes. Sample counts are multiples of the lanes; callers pad with zeros.
"""

from itertools import product

TILE_ROWS = 4
TILE_COLUMNS = 3
FIR_OUTPUTS = 4


def _until(counter: str, step: int, limit: str, done: str, again: str) -> str:
    """The end of a loop: count on to `%counter1`, and leave at the limit."""
    return f"""%{counter}1 = add i64 %{counter}, {step}
%{counter}e = icmp sge i64 %{counter}1, {limit}
br i1 %{counter}e, label %{done}, label %{again}"""


def gram(lanes: int, name: str = "gram") -> str:
    """Inner products of rows.

    `void gram(y, ld, N, tiles, n_tiles, sums)`.

    A tile is a pair of first rows `(a, b)`; it adds the 4 x 3 inner products of rows `a..a+3` and
    `b..b+2` to its 12 vectors of partial sums, one per lane.
    """
    t = f"<{lanes} x double>"
    cells = list(product(range(TILE_ROWS), range(TILE_COLUMNS)))
    size = TILE_ROWS * TILE_COLUMNS
    lines = [f"%o{i} = mul i64 %ld, {i}" for i in range(max(TILE_ROWS, TILE_COLUMNS))]
    head = "\n".join(lines)
    rows = [f"%r{i} = getelementptr double, ptr %pa, i64 %o{i}" for i in range(TILE_ROWS)]
    rows += [f"%s{j} = getelementptr double, ptr %pb, i64 %o{j}" for j in range(TILE_COLUMNS)]
    loads = [
        f"%q{i}_{j} = getelementptr {t}, ptr %g, i64 {i * TILE_COLUMNS + j}\n"
        f"%i{i}_{j} = load {t}, ptr %q{i}_{j}, align 8"
        for i, j in cells
    ]
    phis = [f"%c{i}_{j} = phi {t} [%i{i}_{j}, %tile], [%n{i}_{j}, %samples]" for i, j in cells]
    body = [
        f"%pa{i} = getelementptr double, ptr %r{i}, i64 %b\n%u{i} = load {t}, ptr %pa{i}, align 8"
        for i in range(TILE_ROWS)
    ]
    body += [
        f"%pb{j} = getelementptr double, ptr %s{j}, i64 %b\n%v{j} = load {t}, ptr %pb{j}, align 8"
        for j in range(TILE_COLUMNS)
    ]
    body += [
        f"%m{i}_{j} = fmul contract {t} %u{i}, %v{j}\n"
        f"%n{i}_{j} = fadd contract {t} %c{i}_{j}, %m{i}_{j}"
        for i, j in cells
    ]
    stores = [f"store {t} %n{i}_{j}, ptr %q{i}_{j}, align 8" for i, j in cells]
    return f"""define void @{name}(ptr noalias %y, i64 %ld, i64 %N, ptr noalias %tiles,
    i64 %nt, ptr noalias %sums) {{
entry:
{head}
br label %tile
tile:
%k = phi i64 [0, %entry], [%k1, %done]
%two = mul i64 %k, 2
%ta = getelementptr i64, ptr %tiles, i64 %two
%a = load i64, ptr %ta
%tb = getelementptr i64, ptr %ta, i64 1
%bb = load i64, ptr %tb
%ao = mul i64 %a, %ld
%bo = mul i64 %bb, %ld
%pa = getelementptr double, ptr %y, i64 %ao
%pb = getelementptr double, ptr %y, i64 %bo
%g0 = mul i64 %k, {size}
%g = getelementptr {t}, ptr %sums, i64 %g0
{chr(10).join(rows + loads)}
br label %samples
samples:
%b = phi i64 [0, %tile], [%b1, %samples]
{chr(10).join(phis + body)}
{_until("b", lanes, "%N", "done", "samples")}
done:
{chr(10).join(stores)}
{_until("k", 1, "%nt", "exit", "tile")}
exit:
ret void
}}
"""


def absolute_sums(lanes: int, name: str = "absolute") -> str:
    """Sums of |value| of each row.

    `void absolute(y, ld, N, rows, sums)`.
    """
    t = f"<{lanes} x double>"
    fabs = f"@llvm.fabs.v{lanes}f64"
    return f"""declare {t} {fabs}({t})
define void @{name}(ptr noalias %y, i64 %ld, i64 %N, i64 %rows, ptr noalias %sums) {{
entry:
br label %row
row:
%k = phi i64 [0, %entry], [%k1, %done]
%o = mul i64 %k, %ld
%p = getelementptr double, ptr %y, i64 %o
%q = getelementptr {t}, ptr %sums, i64 %k
%start = load {t}, ptr %q, align 8
br label %samples
samples:
%b = phi i64 [0, %row], [%b1, %samples]
%s = phi {t} [%start, %row], [%s1, %samples]
%px = getelementptr double, ptr %p, i64 %b
%x = load {t}, ptr %px, align 8
%ax = call {t} {fabs}({t} %x)
%s1 = fadd {t} %s, %ax
{_until("b", lanes, "%N", "done", "samples")}
done:
store {t} %s1, ptr %q, align 8
{_until("k", 1, "%rows", "exit", "row")}
exit:
ret void
}}
"""


def decimating_fir(lanes: int, name: str = "fir") -> str:
    """The parallel filter.

    `void fir(y, ldy, rows, taps, T, D, M, z, ldz)`.

    `z[row, m] = sum_k taps[k] * y[row, m * D + k]` for `m < M`. The number of taps `T` is a
    multiple of the lanes (padded with zeros), `M` a multiple of `FIR_OUTPUTS`; a row of `y` holds
    at least `(M - 1) * D + T` samples.
    """
    t = f"<{lanes} x double>"
    reduce = f"@llvm.vector.reduce.fadd.v{lanes}f64"
    outputs = range(FIR_OUTPUTS)
    starts = "\n".join(
        f"%at{u} = add i64 %m, {u}\n%o{u} = mul i64 %at{u}, %D\n"
        f"%p{u} = getelementptr double, ptr %row, i64 %o{u}"
        for u in outputs
    )
    phis = "\n".join(f"%c{u} = phi {t} [zeroinitializer, %group], [%n{u}, %taps]" for u in outputs)
    body = "\n".join(
        f"%px{u} = getelementptr double, ptr %p{u}, i64 %k\n%x{u} = load {t}, ptr %px{u}, align 8\n"
        f"%f{u} = fmul contract {t} %x{u}, %h\n%n{u} = fadd contract {t} %c{u}, %f{u}"
        for u in outputs
    )
    stores = "\n".join(
        f"%z{u} = call reassoc double {reduce}(double 0.0, {t} %n{u})\n"
        f"%pz{u} = getelementptr double, ptr %out, i64 %at{u}\n"
        f"store double %z{u}, ptr %pz{u}, align 8"
        for u in outputs
    )
    return f"""declare double {reduce}(double, {t})
define void @{name}(ptr noalias %y, i64 %ldy, i64 %rows, ptr noalias %h0, i64 %T, i64 %D,
    i64 %M, ptr noalias %z, i64 %ldz) {{
entry:
br label %rowloop
rowloop:
%r = phi i64 [0, %entry], [%r1, %rowdone]
%oy = mul i64 %r, %ldy
%row = getelementptr double, ptr %y, i64 %oy
%oz = mul i64 %r, %ldz
%out = getelementptr double, ptr %z, i64 %oz
br label %group
group:
%m = phi i64 [0, %rowloop], [%m1, %write]
{starts}
br label %taps
taps:
%k = phi i64 [0, %group], [%k1, %taps]
{phis}
%ph = getelementptr double, ptr %h0, i64 %k
%h = load {t}, ptr %ph, align 8
{body}
{_until("k", lanes, "%T", "write", "taps")}
write:
{stores}
{_until("m", FIR_OUTPUTS, "%M", "rowdone", "group")}
rowdone:
{_until("r", 1, "%rows", "exit", "rowloop")}
exit:
ret void
}}
"""


def fused(n_inputs: int, name: str = "fused") -> str:
    """The whole pass without a filter.

    `void fused(N, x0, ld0, ..., B, y, ldy, tiles, n_tiles, sums, rows, absolute)`.

    Runs `program`, `gram` and `absolute` block by block of `B` samples; one block of rows stays in
    the cache and is never seen from outside. `gram` and `absolute` are those of another module.
    """
    inputs = range(n_inputs)
    signature = ", ".join(f"ptr %x{i}, i64 %l{i}" for i in inputs)
    starts = "\n".join(f"%p{i} = getelementptr double, ptr %x{i}, i64 %b" for i in inputs)
    passed = ", ".join(f"ptr %p{i}, i64 %l{i}" for i in inputs)
    return f"""declare void @gram(ptr, i64, i64, ptr, i64, ptr)
declare void @absolute(ptr, i64, i64, i64, ptr)
define void @{name}(i64 %N, {signature}, i64 %B, ptr %y, i64 %ly, ptr %tiles,
    i64 %nt, ptr %sums, i64 %rows, ptr %abs) {{
entry:
br label %loop
loop:
%b = phi i64 [0, %entry], [%next, %loop]
{starts}
%rest = sub i64 %N, %b
%short = icmp slt i64 %rest, %B
%n = select i1 %short, i64 %rest, i64 %B
call void @program(i64 %n, {passed}, ptr %y, i64 %ly)
call void @gram(ptr %y, i64 %ly, i64 %n, ptr %tiles, i64 %nt, ptr %sums)
call void @absolute(ptr %y, i64 %ly, i64 %n, i64 %rows, ptr %abs)
%next = add i64 %b, %B
%done = icmp sge i64 %next, %N
br i1 %done, label %exit, label %loop
exit:
ret void
}}
"""


def sample(n_inputs: int, name: str = "sample") -> str:
    """The program at one sample, with its arguments from memory, and a look at the numbers.

    `i64 sample(arguments)`, 64 bits each: the arguments of `program`; all numbers that are given
    and how many; where the output's first lane goes and its length; the largest sum of squares of
    the given numbers. Returns whether that sum is smaller and all results are finite: from Python
    one call of one argument costs least.
    """
    kinds = ["i64", *["ptr", "i64"] * (n_inputs + 1)]
    loads = "\n".join(
        f"%p{k} = getelementptr i64, ptr %a, i64 {k}\n%v{k} = load {kind}, ptr %p{k}"
        for k, kind in enumerate([*kinds, "ptr", "i64", "ptr", "i64", "double"])
    )
    passed = ", ".join(f"{kind} %v{k}" for k, kind in enumerate(kinds))
    y, ly, given, n_given, result, n_result, limit = (
        f"%v{k}" for k in range(len(kinds) - 2, len(kinds) + 5)
    )
    return f"""define i64 @{name}(ptr %a) {{
entry:
{loads}
call void @program({passed})
br label %in
in:
%i = phi i64 [0, %entry], [%i1, %add]
%s = phi double [0.0, %entry], [%s1, %add]
%more = icmp slt i64 %i, {n_given}
br i1 %more, label %add, label %out
add:
%gi = getelementptr double, ptr {given}, i64 %i
%g = load double, ptr %gi
%gg = fmul double %g, %g
%s1 = fadd double %s, %gg
%i1 = add i64 %i, 1
br label %in
out:
%k = phi i64 [0, %in], [%k1, %copy]
%t = phi double [0.0, %in], [%t1, %copy]
%left = icmp slt i64 %k, {n_result}
br i1 %left, label %copy, label %done
copy:
%ky = mul i64 %k, {ly}
%yk = getelementptr double, ptr {y}, i64 %ky
%r = load double, ptr %yk
%rk = getelementptr double, ptr {result}, i64 %k
store double %r, ptr %rk
%rr = fmul double %r, %r
%t1 = fadd double %t, %rr
%k1 = add i64 %k, 1
br label %out
done:
%small = fcmp olt double %s, {limit}
%finite = fcmp olt double %t, 0x7FF0000000000000
%sound = and i1 %small, %finite
%answer = zext i1 %sound to i64
ret i64 %answer
}}
"""


def recurrence(name: str = "recurrence") -> str:
    """Bounded linear recurrences, `y_k = max(-c_k, min(c_k, a_k y_{k-1} + b_k))`, row by row.

    `void recurrence(a, b, c, y, rows, N, start)`: contiguous rows of `N` samples; `start` holds
    `y_{-1}` of every row and is left holding the last sample's.
    """
    return f"""declare double @llvm.minnum.f64(double, double)
declare double @llvm.maxnum.f64(double, double)
define void @{name}(ptr noalias %a, ptr noalias %b, ptr noalias %c, ptr noalias %y, i64 %rows,
    i64 %N, ptr noalias %start) {{
entry:
br label %row
row:
%k = phi i64 [0, %entry], [%k1, %done]
%o = mul i64 %k, %N
%ps = getelementptr double, ptr %start, i64 %k
%s = load double, ptr %ps
br label %samples
samples:
%i = phi i64 [0, %row], [%i1, %samples]
%y0 = phi double [%s, %row], [%y1, %samples]
%at = add i64 %o, %i
%pa = getelementptr double, ptr %a, i64 %at
%va = load double, ptr %pa
%pb = getelementptr double, ptr %b, i64 %at
%vb = load double, ptr %pb
%pc = getelementptr double, ptr %c, i64 %at
%vc = load double, ptr %pc
%m = fmul double %va, %y0
%t = fadd double %m, %vb
%n = fneg double %vc
%u = call double @llvm.minnum.f64(double %t, double %vc)
%y1 = call double @llvm.maxnum.f64(double %u, double %n)
%py = getelementptr double, ptr %y, i64 %at
store double %y1, ptr %py
{_until("i", 1, "%N", "done", "samples")}
done:
store double %y1, ptr %ps
{_until("k", 1, "%rows", "exit", "row")}
exit:
ret void
}}
"""
