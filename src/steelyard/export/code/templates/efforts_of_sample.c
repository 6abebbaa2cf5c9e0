[% if memory %]
    if (!me->begun) {
        [[ ("tau[" ~ n ~ "] = ") * (passive > 0) ]][[ name ]]_start(&me->state, q, dq);
    }
    [[ ("tau[" ~ n ~ "] = ") * (passive > 0) ]][[ name ]]_step(&me->state, q, dq, ddq, tau);
[% elif passive %]
    tau[[[ n ]]] = me->begun ? [[ name ]]_close(q, me->passive) : [[ name ]]_follow(q, me->passive);
    [[ name ]]_torque(q, me->passive, dq, ddq, tau);
[% else %]
    [[ name ]]_torque(q, dq, ddq, tau);
[% endif %]
