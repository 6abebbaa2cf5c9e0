[[ head ]]
#ifndef [[ name | upper ]]_H
#define [[ name | upper ]]_H

#ifdef __cplusplus
extern "C" {
#endif

#define [[ name | upper ]]_JOINTS [[ n ]]

enum [[ name ]]_joint {
[% for _, joint in joints %]
    [[ name | upper ]]_JOINT_[[ joint | upper ]] = [[ loop.index0 ]][[ "," * (not loop.last) ]]
[% endfor %]
};

[% for _, meaning, c in functions %]
[[ comment([meaning[0] | upper ~ meaning[1:] ~ "; " ~ c.operations ~ " operations, " ~ c.stack ~ " bytes of stack."]) ]]
[[ c.signature ]];

[% endfor %]
[% if parameters is not none %]
#define [[ name | upper ]]_PARAMETERS [[ parameters | length ]]

[[ comment(columns) ]]
void [[ name ]]_parameters([[ real ]] values[[[ parameters | length ]]]);

[% endif %]
[% if passive %]
/*
 * Positions of the passive joints that close the chains at q. close begins at the given
 * passive positions, those of the sample before: Newton's method, at most [[ iterations ]] steps.
 * follow goes straight from the reference configuration to q in [[ closing_steps ]] stretches: for the
 * first sample. Both return the closure error [m]: the largest distance of two points that
 * ought to be one; the chains are open where it is not near zero. It is NaN where an
 * argument is.
 */
[[ real ]] [[ name ]]_close(const [[ real ]] q[[[ n ]]], [[ real ]] passive[[[ passive ]]]);
[[ real ]] [[ name ]]_follow(const [[ real ]] q[[[ n ]]], [[ real ]] passive[[[ passive ]]]);

[% endif %]
[% if memory %]
/*
 * Efforts of the whole model [Nm; N], whose friction remembers the motion. Call start with the
 * first sample of a motion, then step with every sample, the first one included. A motion
 * that begins at some speed is taken to have had it before. The state belongs to the caller;
 * several may exist.
[% if passive %]
 * Both return the closure error of the chains, see close; where it is NaN, step keeps the state.
[% endif %]
 */
typedef struct {
[% if passive %]
    [[ real ]] passive[[[ passive ]]];
[% endif %]
    [[ real ]] memory[[[ memory ]]];
} [[ name ]]_state;

[% if passive %][[ real ]][% else %]void[% endif %] [[ name ]]_start([[ name ]]_state *state, const [[ real ]] q[[[ n ]]], const [[ real ]] dq[[[ n ]]]);
[% if passive %][[ real ]][% else %]void[% endif %] [[ name ]]_step([[ name ]]_state *state, const [[ real ]] q[[[ n ]]], const [[ real ]] dq[[[ n ]]], const [[ real ]] ddq[[[ n ]]], [[ real ]] tau[[[ n ]]]);

[% endif %]
[% if observer %]
/*
 * External efforts [Nm; N] by the generalised momentum: no accelerations are needed. Call start
 * with the bandwidth [Hz], usually [[ name | upper ]]_OBSERVER_BANDWIDTH, then step with every sample: its
 * time [s], positions, velocities and joint efforts. Samples have to come at ten times the
 * bandwidth or faster. step returns 0; 1 at the first sample and after a gap in time, where it
 * begins anew with external efforts of zero; -1 and changes nothing where time does not increase.
[% if passive %]
 * Where the chains cannot close, step returns -2 and keeps all but the time.
[% endif %]
 * The state belongs to the caller; several may exist.
 */
#define [[ name | upper ]]_OBSERVER_BANDWIDTH [[ in_double(observer.bandwidth) ]]

typedef struct {
    double time, rate, longest;
    int started;
[% for x in observed %]
    [[ real ]] [[ x ]][[[ n ]]];
[% endfor %]
[% if passive %]
    [[ real ]] passive[[[ passive ]]];
[% endif %]
[% if memory %]
    [[ real ]] memory[[[ memory ]]];
[% endif %]
[% if observer.thresholds %]
    double visited[[[ n ]]][4];
    double moved[[[ n ]]];
    [[ real ]] limit[[[ n ]]];
[% endif %]
} [[ name ]]_observer;

void [[ name ]]_observer_start([[ name ]]_observer *observer, double bandwidth);
int [[ name ]]_observer_step([[ name ]]_observer *observer, double time, const [[ real ]] q[[[ n ]]], const [[ real ]] dq[[[ n ]]], const [[ real ]] tau[[[ n ]]], [[ real ]] external[[[ n ]]]);
[% if observer.thresholds %]

/*
 * Joints whose external effort exceeds its threshold at the last sample: 1 or 0 per joint. Returns
 * their number. Thresholds are those of [[ "%.3g" | format(observer.thresholds.rate) ]] false alarms per hour, for
 * the usual bandwidth.
 */
int [[ name ]]_observer_contact(const [[ name ]]_observer *observer, int joints[[[ n ]]]);
[% endif %]

[% endif %]
#ifdef __cplusplus
}
#endif

#endif /* [[ name | upper ]]_H */
