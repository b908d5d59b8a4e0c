#include "component.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "integrator.h"
#include "kernel.h"
#include "parameters.h"

/* ---- variables ------------------------------------------------------------------------------------------------ */

const variable *variable_of(int slot)
{
    int low = 0, high = N_VARIABLES - 1;
    while (low < high) {
        int middle = (low + high + 1) / 2;
        if (VARIABLES[middle].first <= slot)
            low = middle;
        else
            high = middle - 1;
    }
    return &VARIABLES[low];
}

void slot_name(int slot, char *name, int size)
{
    const variable *v = variable_of(slot);
    int k = slot - v->first;
    if (v->columns)
        snprintf(name, (size_t)size, "%s[%d,%d]", v->name, k / v->columns + 1, k % v->columns + 1);
    else if (v->role == DERIVATIVE) /* der(state[k]) */
        snprintf(name, (size_t)size, "%.*s[%d])", (int)strlen(v->name) - 1, v->name, k + 1);
    else if (v->size > 1)
        snprintf(name, (size_t)size, "%s[%d]", v->name, k + 1);
    else
        snprintf(name, (size_t)size, "%s", v->name);
}

/* Where the value of a slot that can be set lies; NULL for a computed one. */
static double *place_of(component *c, int slot)
{
    if (slot < FIRST_INPUT + N_INPUTS)
        return &c->s.inputs[slot - FIRST_INPUT];
    if (slot < FIRST_RESULT + N_STATES)
        return &c->s.x[slot - FIRST_RESULT];
    if (slot >= FIRST_PARAMETER && slot < FIRST_PARAMETER + N_PARAMETERS)
        return &c->s.p[slot - FIRST_PARAMETER];
    return slot == FIXED_STEP_SIZE ? &c->s.fixed_step_size : NULL;
}

void component_forget_results(component *c)
{
    c->has_xdot = c->has_results = c->has_legs = 0;
    c->inertia_is_unchecked = 1;
}

void component_reset(component *c)
{
    memset(&c->s, 0, sizeof c->s);
    c->s.stop_time = INFINITY;
    c->s.tolerance = DEFAULT_TOLERANCE;
    c->s.fixed_step_size = START_FIXED_STEP_SIZE;
    memcpy(c->s.x, START_STATES, sizeof c->s.x);
    memcpy(c->s.p, START_PARAMETERS, sizeof c->s.p);
    component_forget_results(c);
}

outcome component_check(component *c, int slot, double value)
{
    const variable *v = variable_of(slot);
    char name[80];
    const char *expected = NULL;
    if (!isfinite(value))
        expected = "a finite number";
    else if (fabs(value) > LARGEST_NUMBER)
        expected = "a number of a machine's size in SI units";
    else if (v->range == POSITIVE && !(value > 0))
        expected = "a value > 0";
    else if (v->range == NOT_NEGATIVE && !(value >= 0))
        expected = "a value >= 0";
    else if (slot == FIRST_RESULT + 4 && !(fabs(value) < LARGEST_PITCH))
        expected = "a pitch within 90 degrees";
    if (!expected)
        return DONE;
    slot_name(slot, name, sizeof name);
    write_message(c->message, "%s = %g %s refused; expected %s", name, value, v->unit, expected);
    return NOT_POSSIBLE;
}

void component_put(component *c, int slot, double value)
{
    double *place = place_of(c, slot);
    if (*place == value)
        return;
    *place = value;
    c->has_xdot = c->has_results = 0;
    if (slot >= FIRST_RESULT)
        c->has_legs = 0;
    if (slot >= FIRST_PARAMETER)
        c->inertia_is_unchecked = 1;
}

/* ---- results -------------------------------------------------------------------------------------------------- */

static int all_finite(const double *values, int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(values[i]))
            return 0;
    return 1;
}

static outcome not_finite(component *c, const char *what)
{
    write_message(c->message, "%s not finite at time %.9g s: the pose is singular, or forces are too large", what,
                  c->s.time);
    return NOT_POSSIBLE;
}

static outcome find_xdot(component *c)
{
    if (!c->has_xdot) {
        kernel_derivatives(c->s.x, c->s.inputs, c->s.p, c->xdot);
        c->has_xdot = 1;
    }
    return all_finite(c->xdot, N_STATES) ? DONE : not_finite(c, "derivatives are");
}

outcome component_get(component *c, int slot, double *value)
{
    const double *place = place_of(c, slot);
    if (place) {
        *value = *place;
    } else if (slot == TIME) {
        *value = c->s.time;
    } else if (slot >= FIRST_DERIVATIVE) {
        outcome found = find_xdot(c);
        if (found != DONE)
            return found;
        *value = c->xdot[slot - FIRST_DERIVATIVE];
    } else {
        int result = slot - FIRST_RESULT;
        if (result < R_LEG_LENGTH + 12 && (c->has_legs || !c->has_results)) {
            /* lengths and rates, without the dynamics */
            if (!c->has_legs) {
                char ignored[MESSAGE_SIZE];
                check_pose(c->s.x, c->s.p, 0, &c->legs, ignored);
                c->has_legs = 1;
            }
            int k = result - R_LEG_LENGTH;
            *value = k < 6 ? c->legs.length[k] : c->legs.length_rate[k - 6];
        } else {
            if (!c->has_results) {
                kernel_outputs(c->s.x, c->s.inputs, c->s.p, c->results);
                c->has_results = 1;
            }
            *value = c->results[result];
        }
        if (!isfinite(*value)) {
            char name[80];
            slot_name(slot, name, sizeof name);
            return not_finite(c, name);
        }
    }
    return DONE;
}

outcome component_derivatives(component *c, double xdot[N_STATES])
{
    outcome found = find_xdot(c);
    if (found == DONE)
        memcpy(xdot, c->xdot, sizeof c->xdot);
    return found;
}

outcome component_forward(component *c, const double dx[], const double du[], const double dp[], double dxdot[],
                          double dy[])
{
    kernel_forward(c->s.x, c->s.inputs, c->s.p, dx, du, dp, dxdot, dy);
    return all_finite(dxdot, N_STATES) && all_finite(dy, N_RESULTS) ? DONE : not_finite(c, "sensitivities are");
}

outcome component_reverse(component *c, const double wxdot[], const double wy[], double gx[], double gu[],
                          double gp[])
{
    kernel_reverse(c->s.x, c->s.inputs, c->s.p, wxdot, wy, gx, gu, gp);
    return all_finite(gx, N_STATES) && all_finite(gu, N_INPUTS) && all_finite(gp, N_PARAMETERS)
               ? DONE
               : not_finite(c, "sensitivities are");
}

outcome component_result_rates(component *c, double rates[N_RESULTS])
{
    static const double no_change[N_PARAMETERS] = {0};
    double dxdot[N_STATES];
    outcome found = find_xdot(c);
    return found == DONE ? component_forward(c, c->xdot, c->s.input_rates, no_change, dxdot, rates) : found;
}

/* ---- time ----------------------------------------------------------------------------------------------------- */

outcome component_set_experiment(component *c, double tolerance, double start_time, double stop_time)
{
    if (!(tolerance >= SMALLEST_TOLERANCE && tolerance <= LARGEST_TOLERANCE)) {
        write_message(c->message, "tolerance = %g refused; expected from %g to %g, say 1e-8", tolerance,
                      SMALLEST_TOLERANCE, LARGEST_TOLERANCE);
        return MISUSE;
    }
    if (!isfinite(start_time) || !(stop_time >= start_time)) {
        write_message(c->message, "start time %g s, stop time %g s refused; expected a finite start, and no earlier stop",
                      start_time, stop_time);
        return MISUSE;
    }
    c->s.tolerance = tolerance;
    c->s.time = start_time;
    c->s.stop_time = stop_time;
    return DONE;
}

outcome component_check_pose(component *c)
{
    char reason[MESSAGE_SIZE];
    c->has_legs = 1;
    if (check_pose(c->s.x, c->s.p, c->s.handedness, &c->legs, reason))
        return DONE;
    write_message(c->message, "at time %.9g s: %s", c->s.time, reason);
    return NOT_POSSIBLE;
}

outcome component_check_inertia(component *c)
{
    if (c->inertia_is_unchecked && !check_inertia(c->s.p, c->message))
        return NOT_POSSIBLE;
    c->inertia_is_unchecked = 0;
    return DONE;
}

outcome component_begin(component *c)
{
    outcome checked = component_check_inertia(c);
    if (checked == DONE)
        checked = component_check_pose(c);
    if (checked == DONE && !check_geometry(c->s.p, c->legs.length, c->message))
        checked = NOT_POSSIBLE;
    if (checked == DONE)
        c->s.handedness = c->legs.handedness;
    return checked;
}

outcome component_set_time(component *c, double time)
{
    if (!isfinite(time)) {
        write_message(c->message, "time = %g s refused; expected a finite number", time);
        return MISUSE;
    }
    c->s.time = time;
    return DONE;
}

outcome component_set_states(component *c, const double x[N_STATES])
{
    for (int i = 0; i < N_STATES; i++) {
        outcome checked = component_check(c, FIRST_RESULT + i, x[i]);
        if (checked != DONE)
            return checked;
    }
    for (int i = 0; i < N_STATES; i++)
        component_put(c, FIRST_RESULT + i, x[i]);
    return DONE;
}

/* One communication step on its way. */
typedef struct {
    component *c;
    const observer *observer;
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

/* The component goes along with the integration: time, states, inputs and derivatives are those of this point. */
static int accept_internal_step(void *owner, double t, const double x[N_STATES], const double xdot[N_STATES],
                                double *end, int *changed)
{
    communication_step *step = owner;
    component *c = step->c;
    c->s.time = t;
    memcpy(c->s.x, x, sizeof c->s.x);
    memcpy(c->xdot, xdot, sizeof c->xdot);
    c->has_xdot = 1;
    c->has_results = 0;
    if (step->interpolates)
        inputs_at(step, t, c->s.inputs);
    if (component_check_pose(c) != DONE)
        return 0;
    if (step->observer) {
        double wanted = *end;
        step->observer->notice(step->observer->context, t, &wanted);
        if (wanted < *end)
            *end = fmax(wanted, t);
        *changed = !c->has_xdot;
        step->since = t;
        memcpy(step->from, c->s.inputs, sizeof step->from);
    }
    return 1;
}

static outcome check_step(component *c, double time, double step)
{
    if (!isfinite(step) || !(step > 0)) {
        write_message(c->message, "communication step = %g s refused; expected a step > 0", step);
        return MISUSE;
    }
    double now = c->s.time, resolution = nextafter(fabs(now), INFINITY) - fabs(now);
    /* rounding of an importer's clock, but never a noticeable share of the step */
    double rounding = fmax(fmin(1e-9 * fmax(1, fabs(now)), 1e-3 * step), 4 * resolution);
    if (!(fabs(time - now) <= rounding)) {
        write_message(c->message, "communication point %.17g s refused; expected the present time %.17g s, steps follow "
                                  "each other", time, now);
        return MISUSE;
    }
    if (!(time + step > now)) {
        write_message(c->message, "communication step = %g s refused; too small to advance time %g s", step, now);
        return MISUSE;
    }
    if (time + step > c->s.stop_time + rounding) {
        write_message(c->message, "communication step to %.9g s refused; it passes the stop time, %.9g s", time + step,
                      c->s.stop_time);
        return MISUSE;
    }
    return DONE;
}

static void explain_failure(component *c, integration how, double time, double end)
{
    const char *remedy = "forces too large, friction too sharp (leg_friction_velocity), or nearly singular";
    if (how == STEP_TOO_SMALL)
        write_message(c->message, "at time %.9g s: the tolerance %g cannot be held; %s", time, c->s.tolerance, remedy);
    else if (how == TOO_MANY_STEPS)
        write_message(c->message, "at time %.9g s: too many internal steps for one step to time %.9g s; %s", time, end,
                      remedy);
    else if (how == NOT_FINITE)
        write_message(c->message, "at time %.9g s: the motion is not finite; fixed_step_size = %g s is too large, or %s",
                      time, c->s.fixed_step_size, remedy);
}

outcome component_step(component *c, double time, double step, const observer *observer, double *reached)
{
    *reached = c->s.time;
    outcome checked = check_step(c, time, step);
    if (checked == DONE)
        checked = component_check_inertia(c);
    if (checked == DONE)
        checked = find_xdot(c);
    if (checked != DONE)
        return checked;

    component_state before = c->s;
    communication_step run = {.c = c, .observer = observer, .since = before.time};
    memcpy(run.from, before.inputs, sizeof run.from);
    for (int i = 0; i < N_INPUTS; i++)
        run.interpolates |= before.input_rates[i] != 0;
    ode problem = {&run, derivatives_in_step, accept_internal_step};
    integration_point at = {.t = before.time, .step = before.internal_step};
    memcpy(at.x, before.x, sizeof at.x);
    memcpy(at.xdot, c->xdot, sizeof at.xdot);

    double end = time + step;
    integration how = before.fixed_step_size > 0 ? integrate_fixed(&problem, &at, end, before.fixed_step_size)
                                                 : integrate_controlled(&problem, &at, end, before.tolerance);
    if (how == REACHED_END) {
        c->s.internal_step = at.step;
        *reached = at.t;
        return DONE;
    }
    c->s = before;
    component_forget_results(c);
    explain_failure(c, how, at.t, end);
    return NOT_POSSIBLE;
}
