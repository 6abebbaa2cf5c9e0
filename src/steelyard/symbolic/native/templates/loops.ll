declare {{ t }} @llvm.fabs.v{{ lanes }}f64({{ t }})
declare double @llvm.vector.reduce.fadd.v{{ lanes }}f64(double, {{ t }})
declare double @llvm.minnum.f64(double, double)
declare double @llvm.maxnum.f64(double, double)

{% macro until(counter, step, limit, done, again) %}
%{{ counter }}1 = add i64 %{{ counter }}, {{ step }}
%{{ counter }}e = icmp sge i64 %{{ counter }}1, {{ limit }}
br i1 %{{ counter }}e, label %{{ done }}, label %{{ again }}
{% endmacro %}
; gram: inner products of rows. A tile is a pair of first rows (a, b); it adds the inner products of
; rows a, a + 1, ... and b, b + 1, ... to its vectors of partial sums, one per lane.
define void @gram(ptr noalias %y, i64 %ld, i64 %N, ptr noalias %tiles, i64 %nt, ptr noalias %sums) {
entry:
{% for i in range([rows, columns] | max) %}
%o{{ i }} = mul i64 %ld, {{ i }}
{% endfor %}
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
%g0 = mul i64 %k, {{ rows * columns }}
%g = getelementptr {{ t }}, ptr %sums, i64 %g0
{% for i in range(rows) %}
%r{{ i }} = getelementptr double, ptr %pa, i64 %o{{ i }}
{% endfor %}
{% for j in range(columns) %}
%s{{ j }} = getelementptr double, ptr %pb, i64 %o{{ j }}
{% endfor %}
{% for i in range(rows) %}
{% for j in range(columns) %}
%q{{ i }}_{{ j }} = getelementptr {{ t }}, ptr %g, i64 {{ i * columns + j }}
%i{{ i }}_{{ j }} = load {{ t }}, ptr %q{{ i }}_{{ j }}, align 8
{% endfor %}
{% endfor %}
br label %samples
samples:
%b = phi i64 [0, %tile], [%b1, %samples]
{% for i in range(rows) %}
{% for j in range(columns) %}
%c{{ i }}_{{ j }} = phi {{ t }} [%i{{ i }}_{{ j }}, %tile], [%n{{ i }}_{{ j }}, %samples]
{% endfor %}
{% endfor %}
{% for i in range(rows) %}
%pa{{ i }} = getelementptr double, ptr %r{{ i }}, i64 %b
%u{{ i }} = load {{ t }}, ptr %pa{{ i }}, align 8
{% endfor %}
{% for j in range(columns) %}
%pb{{ j }} = getelementptr double, ptr %s{{ j }}, i64 %b
%v{{ j }} = load {{ t }}, ptr %pb{{ j }}, align 8
{% endfor %}
{% for i in range(rows) %}
{% for j in range(columns) %}
%m{{ i }}_{{ j }} = fmul contract {{ t }} %u{{ i }}, %v{{ j }}
%n{{ i }}_{{ j }} = fadd contract {{ t }} %c{{ i }}_{{ j }}, %m{{ i }}_{{ j }}
{% endfor %}
{% endfor %}
{{ until("b", lanes, "%N", "done", "samples") }}
done:
{% for i in range(rows) %}
{% for j in range(columns) %}
store {{ t }} %n{{ i }}_{{ j }}, ptr %q{{ i }}_{{ j }}, align 8
{% endfor %}
{% endfor %}
{{ until("k", 1, "%nt", "exit", "tile") }}
exit:
ret void
}

; absolute: sums of |value| of each row.
define void @absolute(ptr noalias %y, i64 %ld, i64 %N, i64 %rows, ptr noalias %sums) {
entry:
br label %row
row:
%k = phi i64 [0, %entry], [%k1, %done]
%o = mul i64 %k, %ld
%p = getelementptr double, ptr %y, i64 %o
%q = getelementptr {{ t }}, ptr %sums, i64 %k
%start = load {{ t }}, ptr %q, align 8
br label %samples
samples:
%b = phi i64 [0, %row], [%b1, %samples]
%s = phi {{ t }} [%start, %row], [%s1, %samples]
%px = getelementptr double, ptr %p, i64 %b
%x = load {{ t }}, ptr %px, align 8
%ax = call {{ t }} @llvm.fabs.v{{ lanes }}f64({{ t }} %x)
%s1 = fadd {{ t }} %s, %ax
{{ until("b", lanes, "%N", "done", "samples") }}
done:
store {{ t }} %s1, ptr %q, align 8
{{ until("k", 1, "%rows", "exit", "row") }}
exit:
ret void
}

; fir: the parallel filter, z[row, m] = sum_k h[k] y[row, m D + k] for m < M. The number of taps T is
; a multiple of the lanes (padded with zeros), M one of the outputs that are computed at once; a row
; of y holds at least (M - 1) D + T samples.
define void @fir(ptr noalias %y, i64 %ldy, i64 %rows, ptr noalias %h0, i64 %T, i64 %D, i64 %M, ptr noalias %z, i64 %ldz) {
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
{% for u in range(outputs) %}
%at{{ u }} = add i64 %m, {{ u }}
%o{{ u }} = mul i64 %at{{ u }}, %D
%p{{ u }} = getelementptr double, ptr %row, i64 %o{{ u }}
{% endfor %}
br label %taps
taps:
%k = phi i64 [0, %group], [%k1, %taps]
{% for u in range(outputs) %}
%c{{ u }} = phi {{ t }} [zeroinitializer, %group], [%n{{ u }}, %taps]
{% endfor %}
%ph = getelementptr double, ptr %h0, i64 %k
%h = load {{ t }}, ptr %ph, align 8
{% for u in range(outputs) %}
%px{{ u }} = getelementptr double, ptr %p{{ u }}, i64 %k
%x{{ u }} = load {{ t }}, ptr %px{{ u }}, align 8
%f{{ u }} = fmul contract {{ t }} %x{{ u }}, %h
%n{{ u }} = fadd contract {{ t }} %c{{ u }}, %f{{ u }}
{% endfor %}
{{ until("k", lanes, "%T", "write", "taps") }}
write:
{% for u in range(outputs) %}
%z{{ u }} = call reassoc double @llvm.vector.reduce.fadd.v{{ lanes }}f64(double 0.0, {{ t }} %n{{ u }})
%pz{{ u }} = getelementptr double, ptr %out, i64 %at{{ u }}
store double %z{{ u }}, ptr %pz{{ u }}, align 8
{% endfor %}
{{ until("m", outputs, "%M", "rowdone", "group") }}
rowdone:
{{ until("r", 1, "%rows", "exit", "rowloop") }}
exit:
ret void
}

; recurrence: bounded linear recurrences, y_k = max(-c_k, min(c_k, a_k y_{k-1} + b_k)), row by row:
; contiguous rows of N samples; start holds y_{-1} of every row and is left holding the last one's.
define void @recurrence(ptr noalias %a, ptr noalias %b, ptr noalias %c, ptr noalias %y, i64 %rows, i64 %N, ptr noalias %start) {
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
{% for x in "abc" %}
%p{{ x }} = getelementptr double, ptr %{{ x }}, i64 %at
%v{{ x }} = load double, ptr %p{{ x }}
{% endfor %}
%m = fmul double %va, %y0
%t = fadd double %m, %vb
%n = fneg double %vc
%u = call double @llvm.minnum.f64(double %t, double %vc)
%y1 = call double @llvm.maxnum.f64(double %u, double %n)
%py = getelementptr double, ptr %y, i64 %at
store double %y1, ptr %py
{{ until("i", 1, "%N", "done", "samples") }}
done:
store double %y1, ptr %ps
{{ until("k", 1, "%rows", "exit", "row") }}
exit:
ret void
}
