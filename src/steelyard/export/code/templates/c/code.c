/*
 * See [[ name ]].h.
 */
#include "[[ name ]].h"

#include <math.h>

[% for text in bodies %]
[[ text ]]
[% endfor %]
[% if parameters is not none %]
void [[ name ]]_parameters([[ real ]] values[[[ parameters | length ]]])
{
[% for x in parameters.values %]
    values[[[ loop.index0 ]]] = [[ literal(x) ]];
[% endfor %]
}

[% endif %]
[% if passive %]
[[ real ]] [[ name ]]_close(const [[ real ]] q[[[ n ]]], [[ real ]] passive[[[ passive ]]])
{
    [[ real ]] nearer[[[ passive ]]], gaps[[[ loops ]]], worst = [[ literal(0.0) ]];
    int i, k;
    for (k = 0; k < [[ iterations ]]; ++k) {
        [[ real ]] moved = [[ literal(0.0) ]];
        [[ name ]]_newton(q, passive, nearer, gaps);
        for (i = 0; i < [[ passive ]]; ++i) {
            const [[ real ]] step = fabs[[ end ]](nearer[i] - passive[i]);
            moved = step <= moved ? moved : step;
            passive[i] = nearer[i];
        }
        if (moved < [[ literal(closing_tolerance) ]]) {
            break;
        }
    }
    [[ name ]]_newton(q, passive, nearer, gaps);
    for (i = 0; i < [[ loops ]]; ++i) {
        worst = gaps[i] <= worst ? worst : gaps[i];
    }
    return sqrt[[ end ]](worst);
}

[[ real ]] [[ name ]]_follow(const [[ real ]] q[[[ n ]]], [[ real ]] passive[[[ passive ]]])
{
    [[ real ]] from[[[ n ]]], here[[[ n ]]], gap = [[ literal(0.0) ]];
    int i, k;
[% for x in assembly[:n] %]
    from[[[ loop.index0 ]]] = [[ literal(x) ]];
[% endfor %]
[% for x in assembly[n:] %]
    passive[[[ loop.index0 ]]] = [[ literal(x) ]];
[% endfor %]
    for (k = 1; k <= [[ closing_steps ]]; ++k) {
        for (i = 0; i < [[ n ]]; ++i) {
            here[i] = from[i] + ([[ real ]])k / [[ literal(closing_steps) ]] * (q[i] - from[i]);
        }
        gap = [[ name ]]_close(here, passive);
    }
    return gap;
}

[% endif %]
[% if memory %]
[% if passive %][[ real ]][% else %]void[% endif %] [[ name ]]_start([[ name ]]_state *state, const [[ real ]] q[[[ n ]]], const [[ real ]] dq[[[ n ]]])
{
[% if passive %]
    const [[ real ]] gap = [[ name ]]_follow(q, state->passive);
    [[ name ]]_begun(q, state->passive, dq, state->memory);
    return gap;
[% else %]
    [[ name ]]_begun(q, dq, state->memory);
[% endif %]
}

[% if passive %][[ real ]][% else %]void[% endif %] [[ name ]]_step([[ name ]]_state *state, const [[ real ]] q[[[ n ]]], const [[ real ]] dq[[[ n ]]], const [[ real ]] ddq[[[ n ]]], [[ real ]] tau[[[ n ]]])
{
    [[ real ]] after[[[ memory ]]];
[% if passive %]
    [[ real ]] passive[[[ passive ]]], gap;
    int i;
    for (i = 0; i < [[ passive ]]; ++i) {
        passive[i] = state->passive[i];
    }
    gap = [[ name ]]_close(q, passive);
    [[ name ]]_stepped(q, passive, dq, ddq, state->memory, tau, after);
    if (gap != gap) {
        return gap;
    }
    for (i = 0; i < [[ passive ]]; ++i) {
        state->passive[i] = passive[i];
    }
[% else %]
    int i;
    [[ name ]]_stepped(q, dq, ddq, state->memory, tau, after);
[% endif %]
    for (i = 0; i < [[ memory ]]; ++i) {
        state->memory[i] = after[i];
    }
[% if passive %]
    return gap;
[% endif %]
}

[% endif %]
[% if observer %]
[% if observer.thresholds %]
/* Thresholds at a sample: a joint is in the slowest range of the last [[ "%g" | format(hold) ]] s. */
static void [[ name ]]_limits([[ name ]]_observer *observer, double time, const [[ real ]] dq[[[ n ]]])
{
    static const [[ real ]] edges[[[ n ]]][3] = {
[% for row in observer.thresholds.edges %]
        {[[ listed(row) ]]}[[ "," * (not loop.last) ]]
[% endfor %]
    };
    static const [[ real ]] limits[[[ n ]]][5] = {
[% for row in limits %]
        {[[ listed(row) ]]}[[ "," * (not loop.last) ]]
[% endfor %]
    };
    int j, range;
    for (j = 0; j < [[ n ]]; ++j) {
        const [[ real ]] speed = fabs[[ end ]](dq[j]);
        const int now = (speed > edges[j][0]) + (speed > edges[j][1]) + (speed > edges[j][2]);
        observer->visited[j][now] = time;
        if (now > 0) {
            observer->moved[j] = time;
        }
        range = 0;
        while (range < now && !(observer->visited[j][range] >= time - [[ in_double(hold) ]])) {
            ++range;
        }
        if (range > 0 || time - observer->moved[j] <= [[ in_double(settled) ]]) {
            ++range;
        }
        observer->limit[j] = limits[j][range];
    }
}

[% endif %]
void [[ name ]]_observer_start([[ name ]]_observer *observer, double bandwidth)
{
    int k;
    observer->time = 0.0;
    observer->rate = [[ in_double(6.283185307179586) ]] * bandwidth;
    observer->longest = [[ in_double(longest[0]) ]] / ([[ in_double(longest[1]) ]] * bandwidth);
    observer->started = 0;
    for (k = 0; k < [[ n ]]; ++k) {
[% for x in observed %]
        observer->[[ x ]][k] = [[ literal(0.0) ]];
[% endfor %]
[% if observer.thresholds %]
[% for k in range(4) %]
        observer->visited[k][[[ k ]]] = -HUGE_VAL;
[% endfor %]
        observer->moved[k] = -HUGE_VAL;
        observer->limit[k] = [[ literal(no_threshold) ]];
[% endif %]
    }
}

int [[ name ]]_observer_step([[ name ]]_observer *observer, double time, const [[ real ]] q[[[ n ]]], const [[ real ]] dq[[[ n ]]], const [[ real ]] tau[[[ n ]]], [[ real ]] external[[[ n ]]])
{
    const double since = time - observer->time;
    const int begins = !observer->started || since > observer->longest;
    [[ real ]] scalars[3], momentum[[[ n ]]], drive[[[ n ]]], slow[[[ n ]]], next[[[ n ]]][% if memory %], after[[[ memory ]]][% endif %];
[% if passive %]
    [[ real ]] passive[[[ passive ]]], gap;
[% endif %]
    int k;
    if (observer->started && !(since > 0.0)) {
        return -1;
    }
[% if passive %]
    for (k = 0; k < [[ passive ]]; ++k) {
        passive[k] = observer->passive[k];
    }
    gap = begins ? [[ name ]]_follow(q, passive) : [[ name ]]_close(q, passive);
    if (gap != gap) {
        return -2;
    }
    for (k = 0; k < [[ passive ]]; ++k) {
        observer->passive[k] = passive[k];
    }
[% endif %]
    scalars[0] = begins ? [[ literal(1.0) ]] : ([[ real ]])exp(-observer->rate * since);
    scalars[1] = begins ? [[ literal(0.0) ]] : ([[ real ]])(1.0 / since);
    scalars[2] = ([[ real ]])observer->rate;
    if (begins) {
[% if memory %]
        [[ name ]]_begun(q, [% if passive %]passive, [% endif %]dq, observer->memory);
[% endif %]
        for (k = 0; k < [[ n ]]; ++k) {
            observer->slow[k] = dq[k];
            observer->external[k] = [[ literal(0.0) ]];
        }
    }
    [[ name ]]_observed(q, [% if passive %]passive, [% endif %]dq, tau, scalars, observer->momentum, observer->drive,
        observer->slow, observer->external[% if memory %], observer->memory[% endif %], momentum, drive, slow, next[% if memory %], after[% endif %]);
    for (k = 0; k < [[ n ]]; ++k) {
        observer->momentum[k] = momentum[k];
        observer->drive[k] = drive[k];
        observer->slow[k] = slow[k];
        observer->external[k] = external[k] = next[k];
    }
[% if memory %]
    for (k = 0; k < [[ memory ]]; ++k) {
        observer->memory[k] = after[k];
    }
[% endif %]
    observer->time = time;
    observer->started = 1;
[% if observer.thresholds %]
    [[ name ]]_limits(observer, time, dq);
[% endif %]
    return begins;
}
[% if observer.thresholds %]

int [[ name ]]_observer_contact(const [[ name ]]_observer *observer, int joints[[[ n ]]])
{
    int k, count = 0;
    for (k = 0; k < [[ n ]]; ++k) {
        joints[k] = fabs[[ end ]](observer->external[k]) > observer->limit[k];
        count += joints[k];
    }
    return count;
}
[% endif %]
[% endif %]
