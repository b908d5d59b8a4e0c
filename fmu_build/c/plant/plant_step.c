#include "plant_step.h"

#include <math.h>
#include <string.h>

#include "bristles.h"
#include "integrator.h"
#include "kernel.h"
#include "plant_table.h"
#include "stable_step.h"

/* The current communication step. */
typedef struct {
    component *c;
    const step_observer *observer;
    int interpolates;
    double since; /* time at which the inputs had the values of `from` */
    double from[N_INPUTS];
} communication_step;

static void inputs_at(const communication_step *step, double t, double u[N_INPUTS])
{
    for (int i = 0; i < N_INPUTS; i++)
        u[i] = step->from[i] + step->c->s.input_rates[i] * (t - step->since);
}

static void derivatives_in_step(void *owner, double t, const double x[N_STATES], double xdot[N_STATES])
{
    const communication_step *step = owner;
    double u[N_INPUTS];
    if (step->interpolates)
        inputs_at(step, t, u);
    kernel_derivatives(x, step->interpolates ? u : step->c->s.inputs, step->c->s.p, xdot);
}

#if HAS_BRISTLES
static void decays_in_step(void *owner, const double x[N_STATES], double decay[N_LEGS])
{
    const communication_step *step = owner;
    kernel_decays(x, step->c->s.p, decay);
}

static void grip_in_step(void *owner, const double x[N_STATES], grip *found)
{
    const communication_step *step = owner;
    kernel_grip(x, step->c->s.p, found->decay, found->gain, found->ratio, found->reach, found->sliding);
}

static void sliding_in_step(void *owner, const double x[N_STATES], double sliding[N_LEGS])
{
    const communication_step *step = owner;
    kernel_sliding(x, step->c->s.p, sliding);
}
#endif

/* Updates the component to this point of the integration: time, states, inputs and derivatives. */
static int accept_internal_step(void *owner, double t, const double x[N_STATES], const double xdot[N_STATES],
                                double *end, int *changed)
{
    communication_step *step = owner;
    component *c = step->c;
    c->s.time = t;
    memcpy(c->s.x, x, sizeof c->s.x);
    memcpy(c->xdot, xdot, sizeof c->xdot);
    c->has_xdot = 1;
    c->has_results = c->has_legs = 0;
    if (step->interpolates)
        inputs_at(step, t, c->s.inputs);
    if (component_check_state(c) != DONE)
        return 0;
    if (step->observer) {
        double requested_end = *end, before[N_INPUTS];
        memcpy(before, c->s.inputs, sizeof before);
        step->observer->notice(step->observer->context, t, &requested_end);
        if (requested_end < *end)
            *end = fmax(requested_end, t);
        /* not `!has_xdot`: the observer may have read derivatives after setting inputs */
        *changed = memcmp(before, c->s.inputs, sizeof before) != 0;
        step->since = t;
        memcpy(step->from, c->s.inputs, sizeof step->from);
    }
    return 1;
}

/* The failure of an integration that gave up at a point; one of `accept` has been explained. */
static void explain_failure(component *c, integration how, const integration_point *at, double end)
{
    const char *cause = "forces too large, leg_friction_velocity too small, or pose nearly singular";
    double fixed = c->s.fixed_step_size;
    if (fixed > 0 && (how == TOO_MANY_STEPS || how == STEP_TOO_SMALL))
        refuse_step(c, "fixed_step_size", fixed, " s",
                    "too small for one step to time %.12g s; expected at most %d steps, each large enough to advance the "
                    "time", end, MOST_FIXED_STEPS);
    else if (how == STEP_TOO_SMALL)
        refuse_step(c, "internal step size", at->step, " s", "the tolerance %g cannot be met; %s", c->s.tolerance, cause);
    else if (how == TOO_MANY_STEPS)
        refuse_step(c, "internal steps", MOST_INTERNAL_STEPS, "", "too many internal steps for one step to time %.12g s "
                    "at tolerance %g; %s", end, c->s.tolerance, cause);
    else if (how == TOO_FAST)
        refuse_step(c, "fixed_step_size", fixed, " s", "no division resolves legs that stick in such a step; expected at "
                    "most %.2g s, or 0 for error control", at->step);
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

outcome step_plant(component *c, double time, double step, const step_observer *observer, double *reached)
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
    integration_point at = {.t = c->s.time, .step = c->s.internal_step};
    checked = component_derivatives(c, at.xdot);
    if (checked != DONE) {
        c->s = before;
        forget_results(c);
        return checked;
    }
    memcpy(at.x, c->s.x, sizeof at.x);

    communication_step run = {.c = c, .observer = observer, .since = before.time};
    memcpy(run.from, c->s.inputs, sizeof run.from);
    for (int i = 0; i < N_INPUTS; i++)
        run.interpolates |= before.input_rates[i] != 0;
    ode problem = {&run, derivatives_in_step, accept_internal_step,
#if HAS_BRISTLES
                   decays_in_step, grip_in_step, sliding_in_step
#endif
    };

    double end = time + step;
    integration how = before.fixed_step_size > 0 ? integrate_fixed(&problem, &at, end, before.fixed_step_size)
                                                 : integrate_controlled(&problem, &at, end, before.tolerance);
    if (how == REACHED_END) {
        c->s.internal_step = at.step;
        *reached = at.t;
        return DONE;
    }
    explain_failure(c, how, &at, end);
    c->s = before;
    forget_results(c);
    return NOT_POSSIBLE;
}
