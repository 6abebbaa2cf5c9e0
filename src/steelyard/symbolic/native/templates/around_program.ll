; sample: the program at one sample, with its arguments from memory, and a look at the numbers.
; Arguments are of 64 bits each: those of program; all numbers that are given and how many; where the
; output's first lane goes and its length; the largest sum of squares of the given numbers. Returns
; whether that sum is smaller and all results are finite: from Python one call of one argument costs
; least.
{% set kinds = ["i64"] + ["ptr", "i64"] * (inputs + 1) %}
{% set y, ly, given, n_given, result, n_result, limit = range(kinds | length - 2, kinds | length + 5) %}
define i64 @sample(ptr %a) {
entry:
{% for kind in kinds + ["ptr", "i64", "ptr", "i64", "double"] %}
%p{{ loop.index0 }} = getelementptr i64, ptr %a, i64 {{ loop.index0 }}
%v{{ loop.index0 }} = load {{ kind }}, ptr %p{{ loop.index0 }}
{% endfor %}
call void @program({% for kind in kinds %}{{ kind }} %v{{ loop.index0 }}{{ ", " if not loop.last else "" }}{% endfor %})
br label %in
in:
%i = phi i64 [0, %entry], [%i1, %add]
%s = phi double [0.0, %entry], [%s1, %add]
%more = icmp slt i64 %i, %v{{ n_given }}
br i1 %more, label %add, label %out
add:
%gi = getelementptr double, ptr %v{{ given }}, i64 %i
%g = load double, ptr %gi
%gg = fmul double %g, %g
%s1 = fadd double %s, %gg
%i1 = add i64 %i, 1
br label %in
out:
%k = phi i64 [0, %in], [%k1, %copy]
%t = phi double [0.0, %in], [%t1, %copy]
%left = icmp slt i64 %k, %v{{ n_result }}
br i1 %left, label %copy, label %done
copy:
%ky = mul i64 %k, %v{{ ly }}
%yk = getelementptr double, ptr %v{{ y }}, i64 %ky
%r = load double, ptr %yk
%rk = getelementptr double, ptr %v{{ result }}, i64 %k
store double %r, ptr %rk
%rr = fmul double %r, %r
%t1 = fadd double %t, %rr
%k1 = add i64 %k, 1
br label %out
done:
%small = fcmp olt double %s, %v{{ limit }}
%finite = fcmp olt double %t, 0x7FF0000000000000
%sound = and i1 %small, %finite
%answer = zext i1 %sound to i64
ret i64 %answer
}
