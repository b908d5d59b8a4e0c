/* A sampled controller as a component. The controller itself is generated plain C, controller.h and controller.c;
   controller_table.h has the slots of its variables.

   The controller is called at start_time + k sample_time / STEPS_A_SAMPLE; a step is a sample, unless it carries drives
   or sensors of its machine, with shorter steps. The inputs of a step determine the forces from output_delay samples
   later on, independent of the communication steps: output_delay is at least 1, so outputs have no direct feedthrough.
   A step at a communication point belongs to the communication step that begins there, after the importer has set the
   inputs. */
#include "component.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "controller.h"
#include "controller_table.h"
#include "model.h"

/* The outputs that wait in the delay line: actuator_force, force_limited, and rate_limited if there is one. */
#define N_DELAYED (HAS_RATE_LIMITED ? 18 : 12)
#define N_PLANNED (MOST_OUTPUT_DELAY * STEPS_A_SAMPLE)

/* The complete state. It has doubles only, since a saved state is a copy of them in this order. */
typedef struct {
    double time, start_time;
    double stop_time;                                /* infinite if there is none */
    double input_rates[N_INPUTS > 0 ? N_INPUTS : 1]; /* du/dt from the current time on */
    double slots[N_SLOTS];                           /* all values but time; outputs as they are since the last step */
    double planned[N_PLANNED][N_DELAYED];            /* the outputs of step k at k modulo N_PLANNED */
    controller_memory memory;                        /* with the number of steps taken, `samples` */
} controller_state;

_Static_assert(sizeof(controller_parameters) == N_PARAMETERS * sizeof(double), "the table has the controller's parameters");
_Static_assert(sizeof(controller_memory) % sizeof(double) == 0, "the memory is a vector of doubles");

struct component {
    controller_state s;
    /* derived from the parameters */
    int is_prepared;
    controller_coefficients coefficients;
    char message[MESSAGE_SIZE];
};

const size_t COMPONENT_SIZE = sizeof(component);
const size_t N_SAVED = sizeof(controller_state) / sizeof(double);

/* ---- variables ------------------------------------------------------------------------------------------------ */

static int is_parameter(int slot) { return slot >= FIRST_PARAMETER && slot < FIRST_PARAMETER + N_PARAMETERS; }
static const double *start_force(const component *c) { return c->s.slots + START_FORCE; }

void component_reset(component *c)
{
    memset(c, 0, sizeof *c);
    c->s.stop_time = INFINITY;
    memcpy(c->s.slots + FIRST_INPUT, START_INPUTS, N_INPUTS * sizeof(double));
    memcpy(c->s.slots + FIRST_PARAMETER, START_PARAMETERS, N_PARAMETERS * sizeof(double));
    c->s.slots[OUTPUT_DELAY] = START_OUTPUT_DELAY;
}

const char *component_message(const component *c) { return c->message; }

/* A description of the values that a slot can have, if this is not one of them, else NULL. */
static const char *expected_value(int slot, double value)
{
    int is_delay = value >= 1 && value <= MOST_OUTPUT_DELAY && floor(value) == value;
    return slot == OUTPUT_DELAY && !is_delay ? EXPECTED_OUTPUT_DELAY : expected_of_slot(slot, value);
}

outcome component_check(component *c, int slot, double value)
{
    const char *expected = expected_value(slot, value);
    return expected ? refuse_value(slot, value, expected, c->message) : DONE;
}

void component_put(component *c, int slot, double value)
{
    c->is_prepared = c->is_prepared && (!is_parameter(slot) || c->s.slots[slot] == value);
    c->s.slots[slot] = value;
}

void component_put_input_rate(component *c, int slot, double rate) { c->s.input_rates[slot - FIRST_INPUT] = rate; }

outcome component_get(component *c, int slot, double *value)
{
    int leg = slot - ACTUATOR_FORCE;
    if (slot == TIME)
        *value = c->s.time;
    else if (leg >= 0 && leg < 6 && !(c->s.memory.samples > 0)) /* until the first step the start forces act */
        *value = start_force(c)[leg];
    else
        *value = c->s.slots[slot];
    return DONE;
}

/* ---- parameters ----------------------------------------------------------------------------------------------- */

/* The struct is a vector of doubles, in the order of the slots. */
static controller_parameters parameters_of(const component *c)
{
    controller_parameters p;
    for (int k = 0; k < N_PARAMETERS; k++) {
        double value = c->s.slots[FIRST_PARAMETER + k];
        value = IS_NONE_AT_ZERO(FIRST_PARAMETER + k) && value == 0 ? INFINITY : value;
        memcpy((char *)&p + (size_t)k * sizeof value, &value, sizeof value);
    }
    return p;
}

/* The message for an invalid parameter has its values and what is expected. */
outcome component_check_parameters(component *c)
{
    static const char *const expectations[] = EXPECTATIONS;
    if (c->is_prepared)
        return DONE;
    controller_parameters p = parameters_of(c);
    int wrong = controller_prepare(&p, &c->coefficients); /* counts variables from 1 */
    c->is_prepared = !wrong;
    if (!wrong)
        return DONE;
    const variable *v = variable_of(FIRST_PARAMETER) + wrong - 1;
    char values[120] = "";
    for (int k = 0; k < v->size && k < 6; k++) {
        size_t length = strlen(values);
        snprintf(values + length, sizeof values - length, " %g", c->s.slots[v->first + k]);
    }
    return write_message(c->message, "%s =%s%s %s rejected; expected %s", v->name, values, v->size > 6 ? " ..." : "",
                         v->unit, expectations[wrong - 1]);
}

/* ---- time ----------------------------------------------------------------------------------------------------- */

outcome component_set_experiment(component *c, double tolerance, double start_time, double stop_time)
{
    (void)tolerance; /* nothing is integrated */
    return start_experiment(&c->s.time, start_time, stop_time, c->message);
}

outcome component_begin(component *c) { return component_check_parameters(c); }

/* Time from step to step of the controller. */
static double step_period(const component *c) { return c->s.slots[SAMPLE_TIME] / STEPS_A_SAMPLE; }

/* Time of its next step. */
static double next_step(const component *c) { return c->s.start_time + c->s.memory.samples * step_period(c); }

/* Tolerance for the accumulated rounding of an importer's clock. */
static double clock_slack(const component *c, double time)
{
    double rounding = fmax(1e-6 * step_period(c), 1e-9 * fmax(1, fabs(time)));
    return fmin(rounding, 0.05 * step_period(c));
}

static int is_due(const component *c) { return next_step(c) <= c->s.time + clock_slack(c, c->s.time); }

/* ---- a communication step ------------------------------------------------------------------------------------- */

/* Whether the steps can be resolved and counted up to this time. */
static outcome check_samples(component *c, double end)
{
    double latest = fmax(fabs(c->s.start_time), end);
    if (step_period(c) < 1e3 * DBL_EPSILON * latest)
        return write_message(c->message, "sample_time = %g s rejected; it is too short to be resolved at time %g s",
                             c->s.slots[SAMPLE_TIME], latest);
    if (!((end - next_step(c)) / step_period(c) < MOST_SAMPLES))
        return write_message(c->message, "communication step to %.12g s rejected; it has more than %d samples of %g s; "
                                         "use shorter steps", end, MOST_SAMPLES, step_period(c));
    return DONE;
}

static outcome check_inputs(component *c)
{
    if (all_finite(c->s.slots + FIRST_INPUT, N_INPUTS))
        return DONE;
    return write_message(c->message, "at time %.12g s: an input is not finite; its derivative is too large", c->s.time);
}

/* The outputs that a step determines; steps count from 0. */
static double *planned_at(component *c, double step) { return c->s.planned[(size_t)fmod(step, N_PLANNED)]; }

/* One step with the present inputs: its outputs, and the memory after it, which is undefined after a failure. */
static outcome take_step(component *c)
{
    controller_memory *memory = &c->s.memory;
    const controller_parameters p = parameters_of(c);
    const double *inputs = c->s.slots + FIRST_INPUT;
    double force[6], *outputs = planned_at(c, memory->samples);
    unsigned char limited[6];
    if (check_inputs(c) != DONE)
        return NOT_POSSIBLE;
    if (!(memory->samples > 0)) {
        memcpy(c->s.slots + ACTUATOR_FORCE, start_force(c), 6 * sizeof(double));
        controller_start(&p, memory);
    }
#if HAS_SWITCH
    memory->enabled = c->s.slots[ENABLED];
    memcpy(memory->manual_force, c->s.slots + MANUAL_FORCE, sizeof memory->manual_force);
#endif
#if HAS_REFERENCE_INPUTS
    controller_step(&p, &c->coefficients, memory, inputs, inputs + CONTROLLER_N_MEASURED, force, limited);
#else
    controller_step(&p, &c->coefficients, memory, inputs, force, limited);
#endif
    if (memory->input_status >= (double)CONTROLLER_FORCE_NOT_FINITE)
        return write_message(c->message, "at time %.12g s: the forces are not finite; check that the measurements are "
                                         "within the platform's workspace", c->s.time);
    for (int k = 0; k < 6; k++) {
        outputs[k] = force[k];
        outputs[FORCE_LIMITED - ACTUATOR_FORCE + k] = limited[k];
#if HAS_RATE_LIMITED
        outputs[RATE_LIMITED - ACTUATOR_FORCE + k] = memory->rate_limited[k];
#endif
    }
    return DONE;
}

static void advance(component *c, double time)
{
    for (int k = 0; k < N_INPUTS; k++)
        c->s.slots[FIRST_INPUT + k] += c->s.input_rates[k] * (time - c->s.time);
    c->s.time = time;
    if (c->s.memory.samples > 0 && is_due(c)) { /* reports do not wait in the delay line */
        c->s.slots[INPUT_STATUS] = c->s.memory.input_status;
        c->s.slots[INPUT_BAD_TIME] = c->s.memory.input_bad_time;
    }
    /* until the first command has passed the delay line, the start forces act */
    double late = c->s.slots[OUTPUT_DELAY] * STEPS_A_SAMPLE;
    if (c->s.memory.samples >= late && is_due(c))
        memcpy(c->s.slots + FIRST_RESULT, planned_at(c, c->s.memory.samples - late), N_DELAYED * sizeof(double));
}

static outcome run(component *c, double end, const step_observer *observer)
{
    while (c->s.time < end) {
        if (is_due(c) && take_step(c) != DONE)
            return NOT_POSSIBLE;
        double due = next_step(c), time = due < end - clock_slack(c, end) ? due : end;
        if (time <= c->s.time) /* more than one sample is due */
            continue;
        advance(c, time);
        if (observer)
            observer->notice(observer->context, time, &end);
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
    if (done != DONE)
        c->s = before;
    *reached = c->s.time;
    return done;
}

/* ---- saved states --------------------------------------------------------------------------------------------- */

_Static_assert(offsetof(component, s) == 0 && offsetof(controller_state, stop_time) == STOP_TIME * sizeof(double),
               "the state is where component.h says");

int component_can_restore(const double saved[])
{
    controller_state s;
    memcpy(&s, saved, sizeof s);
    for (int slot = FIRST_PARAMETER; slot < N_SLOTS; slot++)
        if ((is_parameter(slot) || slot == OUTPUT_DELAY) && expected_value(slot, s.slots[slot]))
            return 0;
    return s.memory.samples >= 0;
}

void component_forget(component *c) { c->is_prepared = 0; }

/* ---- not called: there are no continuous states --------------------------------------------------------------- */

#pragma GCC diagnostic ignored "-Wunused-parameter"
#define NOT_CALLED(name, ...)                                                                                          \
    outcome name(component *c, __VA_ARGS__) { return MISUSE; }
NOT_CALLED(component_set_time, double time)
NOT_CALLED(component_derivatives, double xdot[])
NOT_CALLED(component_forward, const double dx[], const double du[], const double dp[], double dxdot[], double dy[])
NOT_CALLED(component_reverse, const double wxdot[], const double wy[], double gx[], double gu[], double gp[])
NOT_CALLED(component_result_rates, double rates[])
outcome component_check_state(component *c) { return MISUSE; }
