#include "step.h"

#include <float.h>
#include <math.h>

#include "kernel.h"

static void inputs_at(const communication_step *step, double t, double u[N_INPUTS])
{
    for (int i = 0; i < N_INPUTS; i++)
        u[i] = step->from[i] + step->c->s.input_rates[i] * (t - step->since);
}

void find_rates(const communication_step *step, double t, const double x[N_STATES], double rate[N_STATES])
{
    double u[N_INPUTS];
    if (step->interpolates)
        inputs_at(step, t, u);
    kernel_derivatives(x, step->interpolates ? u : step->c->s.inputs, step->c->s.p, rate);
}

void find_stage_rates(const void *of_span, double share, const double x[N_STATES], double rate[N_STATES])
{
    const span *s = of_span;
    find_rates(s->step, s->t + share * s->h, x, rate);
}

/* Moves the component to the end of an internal step: time, states, inputs and derivatives. 0 if it cannot be there. The
   observer may reduce the end of the communication step, and set inputs. */
static int arrive(communication_step *step, double t, const double x[N_STATES], const double rate[N_STATES], double *end)
{
    component *c = step->c;
    c->s.time = t;
    memcpy(c->s.x, x, sizeof c->s.x);
    memcpy(c->xdot, rate, sizeof c->xdot);
    c->has_xdot = 1;
    c->has_results = c->has_legs = 0;
    if (step->interpolates)
        inputs_at(step, t, c->s.inputs);
    if (component_check_state(c) != DONE)
        return 0;
    if (!step->observer)
        return 1;
    double requested_end = *end;
    step->observer->notice(step->observer->context, t, &requested_end);
    if (requested_end < *end)
        *end = fmax(requested_end, t);
    step->since = t;
    memcpy(step->from, c->s.inputs, sizeof step->from);
    if (!c->has_xdot)
        find_rates(step, t, c->s.x, c->xdot);
    c->has_xdot = 1;
    return 1;
}

/* ---- error control -------------------------------------------------------------------------------------------- */

static integration integrate_controlled(communication_step *step, double end, double tolerance)
{
    component *c = step->c;
    double proposed = step->size > 0 ? step->size : end - c->s.time, x[N_STATES];
    stages s;
    for (long steps = 0; c->s.time < end; steps++) {
        if (steps == MOST_INTERNAL_STEPS)
            return TOO_MANY_STEPS;
        double left = end - c->s.time, size = step->size = size_of(proposed, left);
        double t = size < left ? c->s.time + size : end;
        if (!(t > c->s.time) || (size < left && size < 16 * DBL_EPSILON * fabs(end)))
            return STEP_TOO_SMALL;
        const span of_step = {step, c->s.time, size};
#if HAS_BRISTLES
        double decay[N_LEGS];
        kernel_decays(c->s.x, c->s.p, decay);
        for (int k = 0; k < N_LEGS; k++)
            s.bristles[k].decay = decay[k];
#endif
        memcpy(s.rate[0], c->xdot, sizeof c->xdot);
        take_step(&s, size, c->s.x, find_stage_rates, &of_step, x);
        find_rates(step, t, x, s.rate[STAGES]);
        double ratio = error_of_step(&s, size, c->s.x, x) / tolerance;
        proposed = step->size = proposal_after(proposed, size, ratio);
        if (ratio <= 1 && !arrive(step, t, x, s.rate[STAGES], &end))
            return GIVEN_UP;
    }
    return REACHED_END;
}

/* ---- fixed steps ---------------------------------------------------------------------------------------------- */

/* One step to t: the state there and its derivatives. */
static integration fixed_step(communication_step *step, double t, double x[N_STATES], double rate[N_STATES])
{
#if HAS_BRISTLES
    return sticking_step(step, t, x, rate);
#else
    const component *c = step->c;
    const span of_step = {step, c->s.time, t - c->s.time};
    double rates[4][N_STATES];
    memcpy(rates[0], c->xdot, sizeof c->xdot);
    rk4_step(of_step.h, c->s.x, rates, find_stage_rates, &of_step, x);
    find_rates(step, t, x, rate);
    return all_finite(x, N_STATES) && all_finite(rate, N_STATES) ? REACHED_END : NOT_FINITE;
#endif
}

/* Number of equal steps of at most `size`, within the rounding of times of this magnitude. */
static double number_of_steps(double start, double end, double size)
{
    double slack = 1e-6 + 2 * DBL_EPSILON * fabs(start) / size;
    return fmax(1, ceil((end - start) / size - slack));
}

/* Equal steps, the largest not above `size`. */
static integration integrate_fixed(communication_step *step, double end, double size)
{
    component *c = step->c;
    double start = c->s.time, n = number_of_steps(start, end, size), span = end - start, planned = end;
    double x[N_STATES], rate[N_STATES];
    long done = 0;
    if (n > MOST_FIXED_STEPS)
        return TOO_MANY_STEPS;
    while (c->s.time < end) {
        if (end != planned) { /* the observer has reduced it; no more steps than were left */
            start = c->s.time;
            n = number_of_steps(start, end, size);
            span = end - start;
            planned = end;
            done = 0;
        }
        done++;
        double t = (double)done < n ? start + span * ((double)done / n) : end;
        if (!(t > c->s.time))
            return STEP_TOO_SMALL;
        integration how = fixed_step(step, t, x, rate);
        if (how != REACHED_END)
            return how;
        if (!arrive(step, t, x, rate, &end))
            return GIVEN_UP;
    }
    return REACHED_END;
}

/* ---- the communication step ----------------------------------------------------------------------------------- */

/* The failure of an integration that gave up; one of `arrive` has been explained. */
static void explain_failure(const communication_step *step, integration how, double end)
{
    component *c = step->c;
    const char *cause = "forces too large, leg_friction_velocity too small, or pose nearly singular";
    double fixed = c->s.fixed_step_size;
    if (fixed > 0 && (how == TOO_MANY_STEPS || how == STEP_TOO_SMALL))
        refuse_step(c, "fixed_step_size", fixed, " s",
                    "too small for one step to time %.12g s; expected at most %d steps, each large enough to advance the "
                    "time", end, MOST_FIXED_STEPS);
    else if (how == STEP_TOO_SMALL)
        refuse_step(c, "internal step size", step->size, " s", "the tolerance %g cannot be met; %s", c->s.tolerance, cause);
    else if (how == TOO_MANY_STEPS)
        refuse_step(c, "internal steps", MOST_INTERNAL_STEPS, "", "too many internal steps for one step to time %.12g s "
                    "at tolerance %g; %s", end, c->s.tolerance, cause);
    else if (how == TOO_FAST)
        refuse_step(c, "fixed_step_size", fixed, " s", "no division resolves legs that stick in such a step; expected at "
                    "most %.2g s, or 0 for error control", step->size);
    else if (how == NOT_FINITE)
        refuse_step(c, "fixed_step_size", fixed, " s", "the motion is not finite; the step is too large, or %s", cause);
}

/* Some masters do not propagate start values and begin with zeros; if the actuator forces are connected, zeros mean
   that the controller has no output yet. */
static int forces_are_unset(const component *c)
{
    int is_zero = ZEROS_ARE_UNSET_AT_START && c->s.time == c->s.start_time;
    for (int leg = 0; leg < N_LEGS; leg++)
        is_zero = is_zero && c->s.inputs[leg] == 0;
    return is_zero;
}

/* A step in which the modes of sticking or elastic legs would grow, or rest where they should not, is refused. */
static outcome check_fixed_step(component *c, double time, double step)
{
    if (!(c->s.fixed_step_size > 0))
        return DONE;
    double h = step / number_of_steps(time, time + step, c->s.fixed_step_size);
    double largest = c->s.largest_step > 0 ? c->s.largest_step : stable_step(c->s.x, c->s.inputs, c->s.p);
    /* the difference of two rounded times may be larger than the size that was set */
    if (h <= largest * (1 + 1e-9)) {
        /* rigid legs without bristles have no limit; a saved state is finite */
        c->s.largest_step = isfinite(largest) ? largest : 0;
        return DONE;
    }
    return refuse_step(c, "fixed_step_size", h, " s", "steps of %g s are too large for legs that stick or give like these; "
                       "expected at most %.3g s, or 0 for error control", h, largest);
}

outcome component_step(component *c, double time, double step, const step_observer *observer, double *reached)
{
    *reached = c->s.time;
    outcome checked = check_step(c->s.time, c->s.stop_time, time, step, c->message);
    if (checked == DONE)
        checked = component_check_parameters(c);
    if (checked != DONE)
        return checked;
    plant_state before = c->s;
    checked = check_fixed_step(c, c->s.time, step);
    if (checked != DONE)
        return checked;
    if (forces_are_unset(c))
        for (int leg = 0; leg < N_LEGS; leg++)
            component_put(c, FIRST_INPUT + leg, START_INPUTS[leg]);
    communication_step run = {.c = c, .observer = observer, .since = before.time, .size = c->s.internal_step};
    memcpy(run.from, c->s.inputs, sizeof run.from);
    for (int i = 0; i < N_INPUTS; i++)
        run.interpolates |= before.input_rates[i] != 0;
    double end = time + step, rate[N_STATES];
    checked = component_derivatives(c, rate);
    if (checked == DONE) {
        integration how = before.fixed_step_size > 0 ? integrate_fixed(&run, end, before.fixed_step_size)
                                                     : integrate_controlled(&run, end, before.tolerance);
        if (how == REACHED_END) {
            c->s.internal_step = run.size;
            *reached = c->s.time;
            return DONE;
        }
        explain_failure(&run, how, end);
        checked = NOT_POSSIBLE;
    }
    c->s = before;
    forget_results(c);
    return checked;
}
