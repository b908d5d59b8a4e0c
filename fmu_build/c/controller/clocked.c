/* A controller whose steps are ticks of a clock: at the start time and after every interval. A tick reads the inputs, and
   its outputs are there at once, unless output_delay is not 0. Between ticks only time passes.

   Ticks at other times are refused, as is a communication step over one: an importer that never ticks the clock would
   get the start forces for ever. */
#include <math.h>
#include <string.h>

#include "communication.h"
#include "sampled.h"

double component_interval(const component *c)
{
    return step_period(c);
}

void component_set_interval(component *c, double interval)
{
    if (interval == step_period(c)) /* without the rounding error of a product */
        return;
    c->s.p.sample_time = interval * STEPS_A_SAMPLE;
    c->is_prepared = c->is_evaluated = 0;
}

int component_is_ticking(const component *c)
{
    return c->s.is_ticking != 0;
}

static outcome evaluate(component *c)
{
    if (c->is_evaluated)
        return DONE;
    if (component_check_parameters(c) != DONE || check_resolution(c, c->s.time) != DONE)
        return NOT_POSSIBLE;
    c->after_tick = c->s.memory;
    c->is_evaluated = take_step(c, &c->after_tick, c->tick) == DONE;
    return c->is_evaluated ? DONE : NOT_POSSIBLE;
}

/* The outputs that act at the tick, all N_DELAYED of them; NULL for those before the first. */
static const double *acting_at_tick(const component *c)
{
    double step = c->s.memory.samples, late = c->s.output_delay * STEPS_A_SAMPLE;
    return late == 0 ? c->tick : step >= late ? c->s.planned[(size_t)fmod(step - late, N_PLANNED)] : NULL;
}

outcome get_at_tick(component *c, int slot, double *value)
{
    if (evaluate(c) != DONE)
        return NOT_POSSIBLE;
    const double *acting = acting_at_tick(c);
    if (slot == INPUT_STATUS)
        *value = c->after_tick.input_status;
    else if (slot == INPUT_BAD_TIME)
        *value = c->after_tick.input_bad_time;
    else if (acting)
        *value = acting[slot - FIRST_RESULT];
    else
        *value = slot < FORCE_LIMITED ? c->s.p.start_force[slot - ACTUATOR_FORCE] : 0;
    return DONE;
}

outcome component_begin_tick(component *c)
{
    double due = next_step(c);
    if (!(fabs(c->s.time - due) <= clock_slack(c, due))) {
        write_message(c->message, "tick at %.17g s rejected; the next one is at %.17g s, since the interval is %g s",
                      c->s.time, due, step_period(c));
        return MISUSE;
    }
    c->s.is_ticking = 1;
    c->is_evaluated = 0;
    return DONE;
}

outcome component_end_tick(component *c)
{
    if (evaluate(c) != DONE)
        return NOT_POSSIBLE;
    const double *acting = acting_at_tick(c);
    memcpy(planned_at(c, c->s.memory.samples), c->tick, sizeof c->tick);
    if (acting)
        memmove(c->s.acting, acting, sizeof c->s.acting);
    else
        memcpy(c->s.acting, c->s.p.start_force, sizeof c->s.p.start_force);
    c->s.memory = c->after_tick;
    c->s.input_status = c->s.memory.input_status;
    c->s.input_bad_time = c->s.memory.input_bad_time;
    c->s.is_ticking = 0;
    c->is_evaluated = 0;
    return DONE;
}

outcome component_tick(component *c, double time)
{
    double before = c->s.time;
    if (!isfinite(time)) {
        write_message(c->message, "activation time %g s rejected; expected a finite time", time);
        return MISUSE;
    }
    c->s.time = time;
    outcome done = component_begin_tick(c);
    if (done == DONE)
        done = component_end_tick(c);
    if (done != DONE) {
        c->s.time = before;
        c->s.is_ticking = 0;
    }
    return done;
}

outcome component_step(component *c, double time, double step, const step_observer *observer, double *reached)
{
    (void)observer; /* there are no internal steps */
    *reached = c->s.time;
    outcome done = check_step(c->s.time, c->s.stop_time, time, step, c->message);
    if (done == DONE)
        done = component_check_parameters(c);
    if (done == DONE)
        done = check_resolution(c, time + step);
    if (done != DONE)
        return done;
    double due = next_step(c);
    if (due < time + step - clock_slack(c, due)) {
        write_message(c->message, "communication step to %.12g s rejected; the clock ticks at %.12g s: expected "
                                  "fmi3EnterEventMode, fmi3SetClock and fmi3UpdateDiscreteStates there", time + step, due);
        return MISUSE;
    }
    *reached = c->s.time = time + step;
    return DONE;
}
