/* A communication step of a sampled controller. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "communication.h"
#include "sampled.h"

/* Time from step to step of the controller. */
static double period(const component *c)
{
    return c->s.p.sample_time / STEPS_A_SAMPLE;
}

/* Time of its next step. */
static double next_sample(const component *c)
{
    return c->s.start_time + c->s.memory.samples * period(c);
}

/* Tolerance for the accumulated rounding of an importer's clock. */
static double slack_at(const component *c, double time)
{
    double rounding = fmax(1e-6 * period(c), 1e-9 * fmax(1, fabs(time)));
    return fmin(rounding, 0.05 * period(c));
}

static int is_due(const component *c)
{
    return next_sample(c) <= c->s.time + slack_at(c, c->s.time);
}

static outcome check_samples(component *c, double end)
{
    double sample_time = c->s.p.sample_time, latest = fmax(fabs(c->s.start_time), end);
    if (period(c) < 1e3 * DBL_EPSILON * latest) {
        write_message(c->message, "sample_time = %g s rejected; it is too short to be resolved at time %g s",
                      sample_time, latest);
        return NOT_POSSIBLE;
    }
    if (!((end - next_sample(c)) / period(c) < MOST_SAMPLES)) {
        write_message(c->message, "communication step to %.12g s rejected; it has more than %d samples of %g s; "
                                  "use shorter steps", end, MOST_SAMPLES, period(c));
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

/* The outputs that a step determines; steps count from 0. */
static double *planned_at(component *c, double step)
{
    return c->s.planned[(size_t)fmod(step, MOST_STEPS_LATE)];
}

static outcome take_sample(component *c)
{
    double force[6], *planned = planned_at(c, c->s.memory.samples);
    unsigned char limited[6];
    if (check_inputs(c) != DONE)
        return NOT_POSSIBLE;
    if (!(c->s.memory.samples > 0)) {
        controller_start(&c->s.p, &c->s.memory);
        memcpy(c->s.acting, c->s.p.start_force, sizeof c->s.p.start_force);
    }
#if HAS_REFERENCE_INPUTS
    controller_step(&c->s.p, &c->coefficients, &c->s.memory, c->s.inputs, c->s.inputs + CONTROLLER_N_MEASURED, force,
                    limited);
#else
    controller_step(&c->s.p, &c->coefficients, &c->s.memory, c->s.inputs, force, limited);
#endif
    if (c->s.memory.input_status >= (double)CONTROLLER_FORCE_NOT_FINITE) {
        write_message(c->message, "at time %.12g s: the forces are not finite; check that the measurements are within "
                                  "the platform's workspace", c->s.time);
        return NOT_POSSIBLE;
    }
    for (int k = 0; k < 6; k++) {
        planned[k] = force[k];
        planned[FORCE_LIMITED - ACTUATOR_FORCE + k] = limited[k];
#if HAS_RATE_LIMITED
        planned[RATE_LIMITED - ACTUATOR_FORCE + k] = c->s.memory.rate_limited[k];
#endif
    }
    return DONE;
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
        double due = next_sample(c), time = due < end - slack_at(c, end) ? due : end;
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
