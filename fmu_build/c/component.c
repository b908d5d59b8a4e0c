#include "component.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "kernel.h"
#include "parameters.h"

/* ---- variables ------------------------------------------------------------------------------------------------ */

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
        expected = "a pitch well within 90 degrees, at most 1.5698 rad";
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
    write_message(c->message, "%s not finite at time %.12g s: the pose is singular, or forces are too large", what,
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
    write_message(c->message, "at time %.12g s: %s", c->s.time, reason);
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
