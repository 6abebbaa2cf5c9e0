/*
 * Compares [[ name ]].c with values that Python computed; ends with 0 if they agree.
 */
#include "[[ name ]].h"

#include <math.h>
#include <stdio.h>

[% for table, array in tables.items() %]
static const [[ real ]] [[ table ]][[[ array.shape[1] ]]][[[ array | length ]]] = {
[% for row in array.T %]
    {[[ listed(row) ]]}[[ "," * (not loop.last) ]]
[% endfor %]
};

[% endfor %]
[% if observer %]
static const double seen_t[[[ samples ]]] = {[[ seen_t ]]};

[% endif %]

static const [[ real ]] allowed = [[ literal(tolerance) ]];
static [[ real ]] worst = [[ literal(0.0) ]];
static int wrong = 0;

static void compare(const [[ real ]] *found, const [[ real ]] *expected, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        const [[ real ]] size = [[ literal(1.0) ]] + fabs[[ end ]](expected[i]);
        const [[ real ]] error = fabs[[ end ]](found[i] - expected[i]) / size;
        /* an error that is no number is not within what is allowed */
        if (!(error <= allowed)) {
            ++wrong;
        }
        if (error > worst) {
            worst = error;
        }
    }
}

int main(void)
{
    int k;
[% for call, sizes, arguments in calls %]
    for (k = 0; k < [[ states ]]; ++k) {
[% for x, size in sizes %]
        [[ real ]] [[ x ]]_found[[[ size ]]];
[% endfor %]
        [[ name ]]_[[ call ]]([[ arguments | join(", ") ]]);
[% for x, size in sizes %]
        compare([[ x ]]_found, [[ call ]]_[[ x ]][k], [[ size ]]);
[% endfor %]
    }
[% endfor %]
[% if passive %]
    for (k = 0; k < [[ states ]]; ++k) {
        [[ real ]] found[[[ passive ]]], none[1] = {[[ literal(0.0) ]]}, gap[1];
        int i;
        for (i = 0; i < [[ passive ]]; ++i) {
            found[i] = passive[k][i] + [[ literal(0.01) ]];
        }
        gap[0] = [[ name ]]_close(q[k], found);
        compare(found, passive[k], [[ passive ]]);
        compare(gap, none, 1);
    }
[% endif %]
[% if memory %]
    {
        [[ name ]]_state state;
        [[ name ]]_start(&state, path_q[0], path_dq[0]);
        for (k = 0; k < [[ samples ]]; ++k) {
            [[ real ]] found[[[ n ]]];
            [[ name ]]_step(&state, path_q[k], path_dq[k], path_ddq[k], found);
            compare(found, path_tau[k], [[ n ]]);
        }
    }
[% endif %]
[% if observer %]
    {
        [[ name ]]_observer observer;
        [[ name ]]_observer_start(&observer, [[ in_double(tested_bandwidth) ]]);
        for (k = 0; k < [[ samples ]]; ++k) {
            [[ real ]] found[[[ n ]]];
            [[ name ]]_observer_step(&observer, seen_t[k], seen_q[k], seen_dq[k], seen_tau[k],
                found);
            compare(found, seen_external[k], [[ n ]]);
        }
    }
[% endif %]
    printf("[[ name ]]: %d values beyond %.3g, largest error %.3g\n",
           wrong, (double)allowed, (double)worst);
    return wrong == 0 ? 0 : 1;
}
