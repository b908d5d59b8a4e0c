#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- messages and permissions --------------------------------------------------------------------------------- */

/* Categories by status; the last stands for all of them. */
static const char *const CATEGORIES[] = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logAll"};
enum { N_CATEGORIES = sizeof CATEGORIES / sizeof CATEGORIES[0], ALL = (1 << N_CATEGORIES) - 1 };

static const struct {
    int kinds, discards, modes;
} ALLOWED[NUMBER_OF_CALLS] = {
#define AS_PERMISSION(name, kinds, discards, modes) {kinds, discards, modes},
    CALLS(AS_PERMISSION)
};

static const char *name_of_mode(fmi_mode mode)
{
    static const char *const names[] = {"the instantiated state", "initialization mode", "event mode",
                                        "continuous-time mode", "step mode", "intermediate update mode",
                                        "the terminated state"};
    int k = 0;
    while (mode >> (k + 1))
        k++;
    return names[k];
}

const char *name_of_kind(fmi_kind kind) { return kind == MODEL_EXCHANGE ? "Model Exchange" : "Co-Simulation"; }

/* Errors are always logged, as in FMI 2.0 (2.1.3) and in FMI 3.0 from 3.0.3 on (2.2.3). */
fmi_status report(const fmi_instance *i, fmi_status status, const char *format, ...)
{
    int category = status == STATUS_ERROR ? 2 : status == STATUS_DISCARD ? 1 : 0;
    int is_logged = status == STATUS_ERROR || (i->logs && i->categories >> category & 1);
    if (i->logger && is_logged) {
        char text[MESSAGE_SIZE], message[MESSAGE_SIZE];
        va_list arguments;
        va_start(arguments, format);
        write_message_of(text, format, arguments);
        va_end(arguments);
        write_message(message, "%s: %s", i->function, text);
        i->layer->deliver(i, status, CATEGORIES[category], message);
    }
    return status;
}

int allows(const fmi_instance *i, fmi_call call)
{
    return ALLOWED[call].kinds & (int)i->kind && ALLOWED[call].modes & (int)i->mode;
}

int is_allowed(fmi_instance *i, fmi_call call)
{
    if (!i)
        return 0;
    if (allows(i, call))
        return 1;
    if (ALLOWED[call].modes == NEVER)
        return report(i, STATUS_ERROR, "not offered by this unit"), 0;
    int has_kind = ALLOWED[call].kinds & (int)i->kind;
    return report(i, STATUS_ERROR, "not allowed in %s", has_kind ? name_of_mode(i->mode) : name_of_kind(i->kind)), 0;
}

fmi_status conclude(fmi_instance *i, fmi_call call, outcome result)
{
    if (result == DONE)
        return STATUS_OK;
    int may_discard = !i->layer->discards_as_listed || ALLOWED[call].discards & (int)i->kind;
    /* in an intermediate update Discard is not allowed */
    int is_error = result == MISUSE || !may_discard || i->mode == INTERMEDIATE;
    return report(i, is_error ? STATUS_ERROR : STATUS_DISCARD, "%s", component_message(i->core));
}

int has_array(fmi_instance *i, const void *array, size_t n, const char *name)
{
    if (!array && n > 0)
        return report(i, STATUS_ERROR, "%s is a null pointer", name), 0;
    return 1;
}

int has_length(fmi_instance *i, size_t found, size_t expected, const char *name)
{
    if (found != expected && found != ONE_EACH)
        return report(i, STATUS_ERROR, "found %lu %s; expected %lu", (unsigned long)found, name,
                      (unsigned long)expected), 0;
    return 1;
}

int has_states(fmi_instance *i, fmi_call call, const void *x, size_t n)
{
    return is_allowed(i, call) && has_length(i, n, N_STATES, "continuous states") && has_array(i, x, n, "the vector");
}

fmi_status set_logging(fmi_instance *i, int on, size_t n, const char *const categories[])
{
    unsigned chosen = n ? 0 : ALL;
    if (!is_allowed(i, CALL_SET_LOGGING) || !has_array(i, categories, n, "categories"))
        return STATUS_ERROR;
    for (size_t k = 0; k < n; k++) {
        int c = 0;
        while (c < N_CATEGORIES && (!categories[k] || strcmp(categories[k], CATEGORIES[c]) != 0))
            c++;
        if (c == N_CATEGORIES)
            return report(i, STATUS_ERROR, "unknown log category '%s'; expected logStatusWarning, logStatusDiscard, "
                          "logStatusError or logAll", categories[k] ? categories[k] : "(null)");
        chosen |= c == N_CATEGORIES - 1 ? ALL : 1u << c;
    }
    i->logs = on;
    i->categories = chosen;
    return STATUS_OK;
}

/* ---- life cycle ----------------------------------------------------------------------------------------------- */

fmi_status begin_anew(fmi_instance *i)
{
    component_reset(i->core);
    i->mode = INSTANTIATED;
    i->last_successful_time = 0;
    return i->step_status = STATUS_OK;
}

fmi_instance *new_instance(fmi_instance *request, const char *name, const char *token)
{
    const char *expected = request->layer->token, *fault = "out of memory";
    fmi_instance *i = NULL;
    size_t length = name ? strlen(name) + 1 : 0;
    if (!name || name[strspn(name, " \t\r\n")] == 0)
        fault = "the instance name is empty; expected a non-empty text";
    else if (!token || !*expected || strcmp(token, expected) != 0)
        fault = "wrong token '%s'; expected '%s'; use the modelDescription.xml of this binary";
    else if (request->kind == MODEL_EXCHANGE && N_STATES == 0)
        fault = "Model Exchange is not offered by this unit; it has Co-Simulation";
    else
        i = malloc(sizeof *i + COMPONENT_SIZE + length);
    request->function = "instantiation";
    if (!i)
        return report(request, STATUS_ERROR, fault, token ? token : "(null)", expected), NULL;
    *i = *request;
    i->categories = ALL;
    i->core = (component *)(void *)(i + 1);
    i->name = memcpy((char *)(i + 1) + COMPONENT_SIZE, name, length);
    begin_anew(i);
    return i;
}

fmi_status set_experiment(fmi_instance *i, fmi_call call, int tolerance_defined, double tolerance, double start_time,
                          int stop_time_defined, double stop_time)
{
    if (!is_allowed(i, call))
        return STATUS_ERROR;
    /* in Model Exchange only the importer uses the tolerance */
    int is_used = tolerance_defined && i->kind == CO_SIMULATION;
    outcome result = component_set_experiment(i->core, is_used ? tolerance : DEFAULT_TOLERANCE, start_time,
                                              stop_time_defined ? stop_time : INFINITY);
    if (result == DONE)
        i->last_successful_time = start_time;
    return conclude(i, call, result);
}

fmi_status change_mode(fmi_instance *i, fmi_call call, fmi_mode next, outcome (*check)(component *c))
{
    if (!is_allowed(i, call))
        return STATUS_ERROR;
    if (check && check(i->core) != DONE)
        return report(i, STATUS_ERROR, "%s", component_message(i->core));
    i->mode = next;
    return STATUS_OK;
}

fmi_status do_step(fmi_instance *i, double time, double step, const step_observer *observer)
{
    if (!is_allowed(i, CALL_DO_STEP))
        return STATUS_ERROR;
    const char *function = i->function;
    outcome stepped = component_step(i->core, time, step, observer, &i->last_successful_time);
    i->mode = STEP; /* after callbacks */
    i->function = function;
    return i->step_status = conclude(i, CALL_DO_STEP, stepped);
}

