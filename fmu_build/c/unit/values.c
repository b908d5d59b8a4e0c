/* Values, rates and derivatives by value reference; see instance.h. */
#include <stdio.h>

#include "instance.h"

static int role_at(int slot)
{
    return (int)variable_of(slot)->role;
}

/* The slots of a reference; logs an error and returns 0 if it is unknown. */
static int find_slots(const fmi_instance *i, const char *function, uint32_t reference, int *first, int *size)
{
    if (i->layer->resolve(reference, first, size))
        return 1;
    report(i, STATUS_ERROR, "%s: no variable has value reference %lu", function, (unsigned long)reference);
    return 0;
}

/* 1 if all references are known and the array has as many values as they have elements. */
static int find_all(const fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                    const void *values, size_t n_values, const char *name)
{
    size_t total = 0;
    int first, size;
    if (!has_array(i, function, references, n, "value references"))
        return 0;
    for (size_t k = 0; k < n; k++) {
        if (!find_slots(i, function, references[k], &first, &size))
            return 0;
        total += (size_t)size;
    }
    return has_length(i, function, n_values, total, name) && has_array(i, function, values, total, name);
}

fmi_status get_values(fmi_instance *i, const char *function, const uint32_t references[], size_t n, double values[],
                      size_t n_values)
{
    if (!is_allowed(i, function, CALL_GET) || !find_all(i, function, references, n, values, n_values, "values"))
        return STATUS_ERROR;
    int first, size;
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        for (int slot = first; slot < first + size; slot++) {
            outcome got = component_get(i->core, slot, values++);
            if (got != DONE)
                return conclude(i, function, CALL_GET, got);
        }
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
static fmi_status check_set(fmi_instance *i, const char *function, int slot, double value)
{
    fmi_call needed = call_to_set(i, slot);
    if (allows(i, needed))
        return conclude(i, function, needed, component_check(i->core, slot, value));
    char name[NAME_SIZE], what[2 * NAME_SIZE];
    write_slot_name(slot, name);
    if (needed == CALL_NOT_OFFERED)
        return report(i, STATUS_ERROR, "%s: %s is computed; only inputs, start values and parameters can be set",
                      function, name);
    snprintf(what, sizeof what, "%s of %s", function, name);
    is_allowed(i, what, needed);
    return STATUS_ERROR;
}

fmi_status set_values(fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                      const double values[], size_t n_values)
{
    if (!is_allowed(i, function, CALL_SET) || !find_all(i, function, references, n, values, n_values, "values"))
        return STATUS_ERROR;
    int first, size;
    size_t at = 0;
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        for (int slot = first; slot < first + size; slot++) {
            fmi_status checked = check_set(i, function, slot, values[at++]);
            if (checked != STATUS_OK)
                return checked;
        }
    }
    at = 0;
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        for (int slot = first; slot < first + size; slot++)
            component_put(i->core, slot, values[at++]);
    }
    return STATUS_OK;
}

fmi_status no_such_type(const fmi_instance *i, const char *function, size_t n)
{
    if (!is_allowed(i, function, CALL_GET))
        return STATUS_ERROR;
    if (n == 0)
        return STATUS_OK;
    return report(i, STATUS_ERROR, "%s: the unit has no variables of this type, only floating-point variables",
                  function);
}

/* ---- derivatives ----------------------------------------------------------------------------------------------*/

/* A vector over all slots, split into the kernel's arguments. */
typedef struct {
    double slots[N_SLOTS];
} by_slot;

static double *inputs_of(by_slot *v) { return v->slots + FIRST_INPUT; }
static double *results_of(by_slot *v) { return v->slots + FIRST_RESULT; } /* beginning with the states */
static double *parameters_of(by_slot *v) { return v->slots + FIRST_PARAMETER; }
static double *derivatives_of(by_slot *v) { return v->slots + FIRST_DERIVATIVE; }

static int is_known(int slot)
{
    int role = role_at(slot), parameter = slot - FIRST_PARAMETER;
    return role == INPUT || role == STATE || (parameter >= 0 && parameter < N_PARAMETERS);
}

static int is_unknown(int slot)
{
    int role = role_at(slot);
    return role == STATE || role == RESULT || role == DERIVATIVE;
}

/* 1 if all references are of variables with a suitable role. */
static int have_roles(const fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                      int (*fits)(int slot), const char *place, const char *expected)
{
    int first, size;
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        if (!fits(first)) {
            report(i, STATUS_ERROR, "%s: %s is not an allowed %s; expected %s", function, variable_of(first)->name,
                   place, expected);
            return 0;
        }
    }
    return 1;
}

static int may_differentiate(const fmi_instance *i, const char *function, const uint32_t unknowns[], size_t n_unknowns,
                             const void *of_unknowns, size_t n_of_unknowns, const uint32_t knowns[], size_t n_knowns,
                             const void *of_knowns, size_t n_of_knowns)
{
    return is_allowed(i, function, CALL_SENSITIVITY) &&
           find_all(i, function, unknowns, n_unknowns, of_unknowns, n_of_unknowns, "values of the unknowns") &&
           find_all(i, function, knowns, n_knowns, of_knowns, n_of_knowns, "values of the knowns") &&
           have_roles(i, function, unknowns, n_unknowns, is_unknown, "unknown",
                      "an output, a local variable or a derivative") &&
           have_roles(i, function, knowns, n_knowns, is_known, "known",
                      "an input, a continuous state or a parameter of the platform");
}

/* Adds the values, in the order of the references, to their slots. */
static void scatter(const fmi_instance *i, const uint32_t references[], size_t n, const double values[], by_slot *v)
{
    int first, size;
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        for (int slot = first; slot < first + size; slot++)
            v->slots[slot] += *values++;
    }
}

static void gather(const fmi_instance *i, const uint32_t references[], size_t n, const by_slot *v, double values[])
{
    int first, size;
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        for (int slot = first; slot < first + size; slot++)
            *values++ = v->slots[slot];
    }
}

fmi_status get_directional_derivative(fmi_instance *i, const char *function, const uint32_t unknowns[],
                                      size_t n_unknowns, const uint32_t knowns[], size_t n_knowns, const double seed[],
                                      size_t n_seed, double sensitivity[], size_t n_sensitivity)
{
    if (!may_differentiate(i, function, unknowns, n_unknowns, sensitivity, n_sensitivity, knowns, n_knowns, seed,
                           n_seed))
        return STATUS_ERROR;
    by_slot direction = {{0}}, change = {{0}};
    scatter(i, knowns, n_knowns, seed, &direction);
    outcome found = component_forward(i->core, results_of(&direction), inputs_of(&direction),
                                      parameters_of(&direction), derivatives_of(&change), results_of(&change));
    if (found == DONE)
        gather(i, unknowns, n_unknowns, &change, sensitivity);
    return conclude(i, function, CALL_SENSITIVITY, found);
}

fmi_status get_adjoint_derivative(fmi_instance *i, const char *function, const uint32_t unknowns[], size_t n_unknowns,
                                  const uint32_t knowns[], size_t n_knowns, const double seed[], size_t n_seed,
                                  double sensitivity[], size_t n_sensitivity)
{
    if (!may_differentiate(i, function, unknowns, n_unknowns, seed, n_seed, knowns, n_knowns, sensitivity,
                           n_sensitivity))
        return STATUS_ERROR;
    by_slot weights = {{0}}, gradient = {{0}};
    scatter(i, unknowns, n_unknowns, seed, &weights);
    outcome found = component_reverse(i->core, derivatives_of(&weights), results_of(&weights),
                                      results_of(&gradient), inputs_of(&gradient), parameters_of(&gradient));
    if (found == DONE)
        gather(i, knowns, n_knowns, &gradient, sensitivity);
    return conclude(i, function, CALL_SENSITIVITY, found);
}

/* ---- rates of inputs and outputs ------------------------------------------------------------------------------ */

static int is_output(int slot)
{
    return (slot >= FIRST_RESULT && slot < FIRST_RESULT + N_OUTPUTS);
}

static int is_input(int slot)
{
    return role_at(slot) == INPUT;
}

fmi_status get_output_rates(fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                            const int32_t orders[], double values[], size_t n_values)
{
    if (!is_allowed(i, function, CALL_GET_OUTPUT_RATES) ||
        !find_all(i, function, references, n, values, n_values, "values") ||
        !has_array(i, function, orders, n, "orders") ||
        !have_roles(i, function, references, n, is_output, "output", "an output"))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++)
        if (orders[k] != 1)
            return report(i, STATUS_ERROR, "%s: order %ld; only order 1 is available", function, (long)orders[k]);
    by_slot rates = {{0}};
    outcome found = component_result_rates(i->core, results_of(&rates));
    if (found == DONE)
        gather(i, references, n, &rates, values);
    return conclude(i, function, CALL_GET_OUTPUT_RATES, found);
}

fmi_status set_input_rates(fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                           const int32_t orders[], const double values[])
{
    if (!is_allowed(i, function, CALL_SET_INPUT_RATES) ||
        !find_all(i, function, references, n, values, ONE_EACH, "values") ||
        !has_array(i, function, orders, n, "orders") ||
        !have_roles(i, function, references, n, is_input, "input", "an input"))
        return STATUS_ERROR;
    int first, size;
    for (size_t k = 0; k < n; k++) {
        if (orders[k] != 1)
            return report(i, STATUS_ERROR, "%s: order %ld; only order 1 is available", function, (long)orders[k]);
        i->layer->resolve(references[k], &first, &size);
        fmi_status checked = conclude(i, function, CALL_SET_INPUT_RATES,
                                      component_check(i->core, first, values[k]));
        if (checked != STATUS_OK)
            return checked;
    }
    for (size_t k = 0; k < n; k++) {
        i->layer->resolve(references[k], &first, &size);
        component_put_input_rate(i->core, first, values[k]);
    }
    return STATUS_OK;
}
