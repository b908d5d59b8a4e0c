/* A communication step of a sampled controller. */
#include <math.h>
#include <string.h>

#include "communication.h"
#include "sampled.h"

static int is_due(const component *c)
{
    return next_step(c) <= c->s.time + clock_slack(c, c->s.time);
}

static outcome check_samples(component *c, double end)
{
    if (check_resolution(c, end) != DONE)
        return NOT_POSSIBLE;
    if (!((end - next_step(c)) / step_period(c) < MOST_SAMPLES)) {
        write_message(c->message, "communication step to %.12g s rejected; it has more than %d samples of %g s; "
                                  "use shorter steps", end, MOST_SAMPLES, step_period(c));
        return NOT_POSSIBLE;
    }
    return DONE;
}

static outcome check_inputs(component *c)
{
    if (all_finite(c->s.inputs, N_INPUTS))
        return DONE;
    write_message(c->message, "at time %.12g s: an input is not finite; its derivative is too large", c->s.time);
    return NOT_POSSIBLE;
}

static outcome take_sample(component *c)
{
    if (check_inputs(c) != DONE)
        return NOT_POSSIBLE;
    if (!(c->s.memory.samples > 0))
        memcpy(c->s.acting, c->s.p.start_force, sizeof c->s.p.start_force);
    return take_step(c, &c->s.memory, planned_at(c, c->s.memory.samples));
}

static void advance(component *c, double time)
{
    for (int k = 0; k < N_INPUTS; k++)
        c->s.inputs[k] += c->s.input_rates[k] * (time - c->s.time);
    c->s.time = time;
    if (c->s.memory.samples > 0 && is_due(c)) { /* reports do not wait in the delay line */
        c->s.input_status = c->s.memory.input_status;
        c->s.input_bad_time = c->s.memory.input_bad_time;
    }
    /* until the first command has passed the delay line, the start forces act */
    double late = c->s.output_delay * STEPS_A_SAMPLE;
    if (c->s.memory.samples >= late && is_due(c))
        memcpy(c->s.acting, planned_at(c, c->s.memory.samples - late), sizeof c->s.acting);
}

static outcome run(component *c, double end, const step_observer *observer)
{
    while (c->s.time < end) {
        outcome sampled = is_due(c) ? take_sample(c) : DONE;
        if (sampled != DONE)
            return sampled;
        double due = next_step(c), time = due < end - clock_slack(c, end) ? due : end;
        if (time <= c->s.time) /* more than one sample is due */
            continue;
        advance(c, time);
        if (observer) {
            double requested_end = end;
            observer->notice(observer->context, time, &requested_end);
            if (requested_end < end)
                end = fmax(requested_end, time);
        }
    }
    return check_inputs(c); /* a state that is not finite could not be restored */
}

outcome component_step(component *c, double time, double step, const step_observer *observer, double *reached)
{
    *reached = c->s.time;
    outcome done = check_step(c->s.time, c->s.stop_time, time, step, c->message);
    if (done == DONE)
        done = component_check_parameters(c);
    if (done == DONE)
        done = check_samples(c, time + step);
    if (done != DONE)
        return done;
    controller_state before = c->s;
    done = run(c, time + step, observer);
    if (done != DONE) {
        c->s = before;
        return done;
    }
    *reached = c->s.time;
    return DONE;
}
