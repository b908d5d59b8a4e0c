/* Values, rates and derivatives by value reference; see instance.h. */
#include <stdio.h>

#include "instance.h"

static int role_at(int slot) { return (int)variable_of(slot)->role; }

/* The slots of known references, one after the other. */
typedef struct {
    const fmi_instance *i;
    const uint32_t *reference, *last;
    int slot, left; /* the slot at hand, and how many of its reference follow */
} slot_walk;

static slot_walk slots_of(const fmi_instance *i, const uint32_t references[], size_t n)
{
    slot_walk at = {.i = i, .reference = references, .last = references + n};
    return at;
}

static int next_slot(slot_walk *at)
{
    if (at->left == 0) {
        if (at->reference == at->last)
            return 0;
        at->i->layer->resolve(*at->reference++, &at->slot, &at->left);
    } else
        at->slot++;
    at->left--;
    return 1;
}

/* 1 if all references are known and the array has as many values as they have elements. */
static int find_all(fmi_instance *i, const uint32_t references[], size_t n, const void *values, size_t n_values,
                    const char *name)
{
    size_t total = 0;
    int first, size;
    if (!has_array(i, references, n, "value references"))
        return 0;
    for (size_t k = 0; k < n; k++) {
        if (!i->layer->resolve(references[k], &first, &size))
            return report(i, STATUS_ERROR, "no variable has value reference %lu", (unsigned long)references[k]), 0;
        total += (size_t)size;
    }
    return has_length(i, n_values, total, name) && has_array(i, values, total, name);
}

fmi_status get_values(fmi_instance *i, const uint32_t references[], size_t n, double values[], size_t n_values)
{
    if (!is_allowed(i, CALL_GET) || !find_all(i, references, n, values, n_values, "values"))
        return STATUS_ERROR;
    for (slot_walk at = slots_of(i, references, n); next_slot(&at);) {
        outcome got = component_get(i->core, at.slot, values++);
        if (got != DONE)
            return conclude(i, CALL_GET, got);
    }
    return STATUS_OK;
}

/* The row of the permission table that applies to setting this slot. */
static fmi_call call_to_set(const fmi_instance *i, int slot)
{
    switch (role_at(slot)) {
    case INPUT: return CALL_SET;
    case STATE: return i->mode == CONTINUOUS ? CALL_SET_CONTINUOUS_STATES : CALL_SET_START;
    case FIXED_PARAMETER: return CALL_SET_START;
    case TUNABLE_PARAMETER:
        return i->mode == CONTINUOUS && i->layer->tunes_continuously ? CALL_SET : CALL_SET_TUNABLE;
    default: return CALL_NOT_OFFERED;
    }
}

/* Whether this slot can be set to this value now. Names are only written for messages, since this runs often. */
static fmi_status check_set(fmi_instance *i, int slot, double value)
{
    fmi_call needed = call_to_set(i, slot);
    if (allows(i, needed))
        return conclude(i, needed, component_check(i->core, slot, value));
    const char *name = NAME_OF_SLOT(slot);
    char refused[2 * NAME_SIZE];
    if (needed == CALL_NOT_OFFERED)
        return report(i, STATUS_ERROR, "%s is computed; only inputs, start values and parameters can be set", name);
    const char *function = i->function;
    snprintf(refused, sizeof refused, "%s of %s", function, name);
    i->function = refused;
    is_allowed(i, needed);
    i->function = function;
    return STATUS_ERROR;
}

/* Puts values into the slots of references if all of them are right. */
static fmi_status put_all(fmi_instance *i, const uint32_t references[], size_t n, const double values[],
                          fmi_status (*check)(fmi_instance *i, int slot, double value),
                          void (*put)(component *c, int slot, double value))
{
    const double *value = values;
    for (slot_walk at = slots_of(i, references, n); next_slot(&at);) {
        fmi_status checked = check(i, at.slot, *value++);
        if (checked != STATUS_OK)
            return checked;
    }
    for (slot_walk at = slots_of(i, references, n); next_slot(&at);)
        put(i->core, at.slot, *values++);
    return STATUS_OK;
}

fmi_status set_values(fmi_instance *i, const uint32_t references[], size_t n, const double values[], size_t n_values)
{
    int is_right = is_allowed(i, CALL_SET) && find_all(i, references, n, values, n_values, "values");
    return is_right ? put_all(i, references, n, values, check_set, component_put) : STATUS_ERROR;
}

fmi_status no_such_type(fmi_instance *i, size_t n)
{
    if (!is_allowed(i, CALL_GET))
        return STATUS_ERROR;
    if (n == 0)
        return STATUS_OK;
    return report(i, STATUS_ERROR, "the unit has no variables of this type, only floating-point variables");
}

/* ---- derivatives ----------------------------------------------------------------------------------------------*/

static int is_input(int slot) { return role_at(slot) == INPUT; }
static int is_output(int slot) { return slot >= FIRST_RESULT && slot < FIRST_RESULT + N_OUTPUTS; }
static int is_known(int slot) { return is_input(slot) || role_at(slot) == STATE || parameter_at(slot) >= 0; }
static int is_unknown(int slot) { return role_at(slot) == STATE || role_at(slot) == RESULT || role_at(slot) == DERIVATIVE; }

/* 1 if all references are of variables with a suitable role. */
static int have_roles(fmi_instance *i, const uint32_t references[], size_t n, int (*fits)(int slot), const char *place,
                      const char *expected)
{
    for (slot_walk at = slots_of(i, references, n); next_slot(&at);)
        if (!fits(at.slot))
            return report(i, STATUS_ERROR, "%s is not an allowed %s; expected %s", variable_of(at.slot)->name, place,
                          expected), 0;
    return 1;
}

/* Gives the values of their slots if they are known, and concludes. */
static fmi_status gather(fmi_instance *i, fmi_call call, outcome result, const uint32_t references[], size_t n,
                         const double by_slot[], double values[])
{
    for (slot_walk at = slots_of(i, references, n); result == DONE && next_slot(&at);)
        *values++ = by_slot[at.slot];
    return conclude(i, call, result);
}

fmi_status differentiate(fmi_instance *i, int is_adjoint, const uint32_t unknowns[], size_t n_unknowns,
                         const uint32_t knowns[], size_t n_knowns, const double seed[], size_t n_seed,
                         double sensitivity[], size_t n_sensitivity)
{
    const double *of_unknowns = is_adjoint ? seed : sensitivity, *of_knowns = is_adjoint ? sensitivity : seed;
    size_t n_of_unknowns = is_adjoint ? n_seed : n_sensitivity, n_of_knowns = is_adjoint ? n_sensitivity : n_seed;
    if (!is_allowed(i, CALL_SENSITIVITY) ||
        !find_all(i, unknowns, n_unknowns, of_unknowns, n_of_unknowns, "values of the unknowns") ||
        !find_all(i, knowns, n_knowns, of_knowns, n_of_knowns, "values of the knowns") ||
        !have_roles(i, unknowns, n_unknowns, is_unknown, "unknown", "an output, a local variable or a derivative") ||
        !have_roles(i, knowns, n_knowns, is_known, "known",
                    "an input, a continuous state or a parameter of the platform"))
        return STATUS_ERROR;
    /* by slot; results begin with the states */
    double in[N_SLOTS] = {0}, out[N_SLOTS] = {0}, of_parameters[N_PARAMETERS];
    for (slot_walk at = is_adjoint ? slots_of(i, unknowns, n_unknowns) : slots_of(i, knowns, n_knowns); next_slot(&at);)
        in[at.slot] += *seed++;
    for (int slot = FIRST_PARAMETER; slot < N_SLOTS; slot++)
        if (parameter_at(slot) >= 0)
            of_parameters[parameter_at(slot)] = in[slot];
    outcome result = is_adjoint ? component_reverse(i->core, in + FIRST_DERIVATIVE, in + FIRST_RESULT, out + FIRST_RESULT,
                                                    out + FIRST_INPUT, of_parameters)
                                : component_forward(i->core, in + FIRST_RESULT, in + FIRST_INPUT, of_parameters,
                                                    out + FIRST_DERIVATIVE, out + FIRST_RESULT);
    for (int slot = FIRST_PARAMETER; slot < N_SLOTS; slot++)
        if (parameter_at(slot) >= 0)
            out[slot] = of_parameters[parameter_at(slot)];
    return is_adjoint ? gather(i, CALL_SENSITIVITY, result, knowns, n_knowns, out, sensitivity)
                      : gather(i, CALL_SENSITIVITY, result, unknowns, n_unknowns, out, sensitivity);
}

/* ---- rates of inputs and outputs ------------------------------------------------------------------------------ */

/* 1 if a call is allowed with such rates, all of order 1. */
static int are_rates(fmi_instance *i, fmi_call call, const uint32_t references[], size_t n, const double values[],
                     size_t n_values, const int32_t orders[], int (*fits)(int slot), const char *place,
                     const char *expected)
{
    if (!is_allowed(i, call) || !find_all(i, references, n, values, n_values, "values") ||
        !has_array(i, orders, n, "orders") || !have_roles(i, references, n, fits, place, expected))
        return 0;
    for (size_t k = 0; k < n; k++)
        if (orders[k] != 1)
            return report(i, STATUS_ERROR, "order %ld; only order 1 is available", (long)orders[k]), 0;
    return 1;
}

fmi_status get_output_rates(fmi_instance *i, const uint32_t references[], size_t n, const int32_t orders[],
                            double values[], size_t n_values)
{
    fmi_call call = CALL_GET_OUTPUT_RATES;
    if (!are_rates(i, call, references, n, values, n_values, orders, is_output, "output", "an output"))
        return STATUS_ERROR;
    double rates[N_SLOTS] = {0};
    outcome result = component_result_rates(i->core, rates + FIRST_RESULT);
    return gather(i, call, result, references, n, rates, values);
}

static fmi_status check_rate(fmi_instance *i, int slot, double rate)
{
    return conclude(i, CALL_SET_INPUT_RATES, component_check(i->core, slot, rate));
}

/* A reference has one slot in FMI 2.0, the only version with this function. */
fmi_status set_input_rates(fmi_instance *i, const uint32_t references[], size_t n, const int32_t orders[],
                           const double values[])
{
    return are_rates(i, CALL_SET_INPUT_RATES, references, n, values, ONE_EACH, orders, is_input, "input", "an input")
               ? put_all(i, references, n, values, check_rate, component_put_input_rate)
               : STATUS_ERROR;
}
