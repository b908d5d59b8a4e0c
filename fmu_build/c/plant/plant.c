#include "plant.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "conditioning.h"
#include "kernel.h"

const size_t COMPONENT_SIZE = sizeof(component);
const size_t N_SAVED = sizeof(plant_state) / sizeof(double);

/* ---- variables ------------------------------------------------------------------------------------------------ */

/* The memory of a slot that can be set; NULL for a computed one. */
static double *place_of(component *c, int slot)
{
    if (slot < FIRST_INPUT + N_INPUTS)
        return &c->s.inputs[slot - FIRST_INPUT];
    if (slot < FIRST_STATE + N_STATES)
        return &c->s.x[slot - FIRST_STATE];
    if (parameter_at(slot) >= 0)
        return &c->s.p[parameter_at(slot)];
    return slot == FIXED_STEP_SIZE ? &c->s.fixed_step_size : NULL;
}

void component_forget(component *c)
{
    c->has_xdot = c->has_results = c->has_legs = 0;
    c->inertia_is_unchecked = 1;
}

void component_reset(component *c)
{
    memset(c, 0, sizeof *c);
    c->s.stop_time = INFINITY;
    c->s.tolerance = DEFAULT_TOLERANCE;
    c->s.fixed_step_size = START_FIXED_STEP_SIZE;
    memcpy(c->s.inputs, START_INPUTS, sizeof c->s.inputs);
    memcpy(c->s.x, START_STATES, sizeof c->s.x);
    memcpy(c->s.p, START_PARAMETERS, sizeof c->s.p);
    component_forget(c);
}

const char *component_message(const component *c) { return c->message; }

outcome component_check(component *c, int slot, double value)
{
    char pitch[80];
    const char *expected = expected_of_slot(slot, value);
    if (!expected && slot == FIRST_STATE + X_PITCH && !(fabs(value) < LARGEST_PITCH)) {
        snprintf(pitch, sizeof pitch, "a pitch below 90 degrees, at most %.5g rad", LARGEST_PITCH);
        expected = pitch;
    }
    return expected ? refuse_value(slot, value, expected, c->message) : DONE;
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
    if (slot >= FIRST_PARAMETER) {
        c->inertia_is_unchecked = 1;
        c->s.largest_step = 0;
    }
}

void component_put_input_rate(component *c, int slot, double rate) { c->s.input_rates[slot - FIRST_INPUT] = rate; }

/* ---- results -------------------------------------------------------------------------------------------------- */

outcome refuse_step(component *c, const char *quantity, double value, const char *unit, const char *reason, ...)
{
    step_failure *failure = &c->failure;
    va_list arguments;
    va_start(arguments, reason);
    write_message_of(failure->reason, reason, arguments);
    va_end(arguments);
    snprintf(failure->quantity, sizeof failure->quantity, "%s", quantity);
    failure->value = value;
    failure->time = c->s.time;
    return write_message(c->message, "at time %.12g s: %s = %.6g%s: %s", c->s.time, quantity, value, unit, failure->reason);
}

static outcome not_finite(component *c, const char *what)
{
    return write_message(c->message, "%s not finite at time %.12g s: the pose is singular or the forces are too large",
                         what, c->s.time);
}

static outcome find_xdot(component *c)
{
    if (!c->has_xdot)
        kernel_derivatives(c->s.x, c->s.inputs, c->s.p, c->xdot);
    c->has_xdot = 1;
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(c->xdot[i]))
            return refuse_step(c, NAME_OF_SLOT(FIRST_DERIVATIVE + i), c->xdot[i], "",
                               "derivatives are not finite; the pose is singular or the forces are too large");
    return DONE;
}

static const leg_state *legs_of(component *c)
{
    leg_state *legs = &c->legs;
    if (!c->has_legs)
        kernel_legs(c->s.x, c->s.p, legs->length, legs->length_rate, legs->jacobian[0], &legs->rho);
    c->has_legs = 1;
    return legs;
}

_Static_assert(R_LEG_LENGTH == N_STATES && R_LEG_VELOCITY == N_STATES + N_LEGS, "legs come after the states");

/* Results other than the states. Leg lengths and rates do not need the dynamics, at a fifth of the cost. */
static double find_result(component *c, int result)
{
    if (result < R_LEG_VELOCITY + N_LEGS && (c->has_legs || !c->has_results)) {
        const leg_state *legs = legs_of(c);
        return result < R_LEG_VELOCITY ? legs->length[result - R_LEG_LENGTH] : legs->length_rate[result - R_LEG_VELOCITY];
    }
    if (!c->has_results)
        kernel_outputs(c->s.x, c->s.inputs, c->s.p, c->results);
    c->has_results = 1;
    return c->results[result];
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
        *value = find_result(c, slot - FIRST_RESULT);
        if (!isfinite(*value))
            return not_finite(c, NAME_OF_SLOT(slot));
    }
    return DONE;
}

outcome component_derivatives(component *c, double xdot[])
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

outcome component_result_rates(component *c, double rates[])
{
    static const double no_change[N_PARAMETERS] = {0};
    double dxdot[N_STATES];
    outcome found = find_xdot(c);
    return found == DONE ? component_forward(c, c->xdot, c->s.input_rates, no_change, dxdot, rates) : found;
}

/* ---- time ----------------------------------------------------------------------------------------------------- */

outcome component_set_experiment(component *c, double tolerance, double start_time, double stop_time)
{
    if (!(tolerance >= SMALLEST_TOLERANCE && tolerance <= LARGEST_TOLERANCE))
        return write_message(c->message, "tolerance = %g rejected; expected %g to %g, for example %g", tolerance,
                             SMALLEST_TOLERANCE, LARGEST_TOLERANCE, DEFAULT_TOLERANCE), MISUSE;
    outcome started = start_experiment(&c->s.time, start_time, stop_time, c->message);
    if (started == DONE)
        c->s.tolerance = tolerance;
    return started;
}

outcome check_pose(component *c, double *handedness)
{
    const double *x = c->s.x;
    const leg_state *legs = legs_of(c);
    int failure = pose_failure(x, N_STATES, legs->length, legs->jacobian, legs->rho, handedness), k = 0;
    switch (failure) {
    case FAILURE_GOES_ON:
        return DONE;
    case FAILURE_NOT_FINITE:
        while (isfinite(x[k]))
            k++;
        return refuse_step(c, NAME_OF_SLOT(FIRST_STATE + k), x[k], "", "the motion is not finite");
    case FAILURE_PITCHED:
        return refuse_step(c, NAME_OF_SLOT(FIRST_STATE + X_PITCH), x[X_PITCH], " rad", "the pitch has reached 90 degrees");
    case FAILURE_SINGULAR:
    case FAILURE_PASSED_SINGULAR:
        return refuse_step(c, "condition number of the leg Jacobian", exact_condition_number(legs->jacobian), "",
                           "the platform has %s; the legs cannot hold it there",
                           failure == FAILURE_SINGULAR ? "reached a singular pose"
                                                       : "passed a singular pose since the last internal step");
    default:
        k = failure - FAILURE_COLLAPSED;
        return refuse_step(c, NAME_OF_SLOT(FIRST_RESULT + R_LEG_LENGTH + k), legs->length[k], " m",
                           "the leg has collapsed");
    }
}

outcome component_check_state(component *c)
{
    double handedness = c->s.handedness;
    return check_pose(c, &handedness);
}

outcome component_check_parameters(component *c)
{
    if (c->inertia_is_unchecked && check_parameters(c->s.p, c->message) != DONE)
        return NOT_POSSIBLE;
    c->inertia_is_unchecked = 0;
    return DONE;
}

outcome component_begin(component *c)
{
    double handedness = c->s.handedness;
    if (component_check_parameters(c) != DONE || check_joints(c->s.p, c->message) != DONE ||
        check_pose(c, &handedness) != DONE || check_start(c->s.p, c->s.x, legs_of(c)->length, c->message) != DONE)
        return NOT_POSSIBLE;
    c->s.handedness = handedness;
    return DONE;
}

outcome component_set_time(component *c, double time)
{
    if (!isfinite(time))
        return write_message(c->message, "time = %g s rejected; expected a finite number", time), MISUSE;
    c->s.time = time;
    return DONE;
}

/* ---- saved states --------------------------------------------------------------------------------------------- */

_Static_assert(offsetof(component, s) == 0 && offsetof(plant_state, stop_time) == STOP_TIME * sizeof(double),
               "the state is where component.h says");

int component_can_restore(const double saved[])
{
    plant_state s;
    memcpy(&s, saved, sizeof s);
    return s.tolerance >= SMALLEST_TOLERANCE && s.tolerance <= LARGEST_TOLERANCE && s.internal_step >= 0 &&
           s.fixed_step_size >= 0 && s.largest_step >= 0;
}
