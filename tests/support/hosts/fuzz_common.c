/* Actions that both versions of the standard have. */
#include "fuzz.h"

static void set_debug_logging(host *h)
{
    static const char *const known[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError"};
    static const char *const unknown[] = {"logEvents", "", "100%n%s", NULL};
    size_t n = below(3);
    const char **categories = exactly(n * sizeof *categories);
    int all = n == 0;
    for (size_t k = 0; k < n; k++) {
        categories[k] = chance(0.05) ? unknown[below(4)] : known[below(4)];
        all |= categories[k] == known[0];
    }
    int on = chance(0.8);
    if (CALL_EITHER(h, fmi2SetDebugLogging, fmi3SetDebugLogging, unit(h), on, n, due(categories)) == OK)
        h->logging = !on || !h->has_logger ? SILENT : all ? ALL_CATEGORIES : SOME_CATEGORIES;
}

static void exit_initialization_mode(host *h)
{
    CALL_EITHER(h, fmi2ExitInitializationMode, fmi3ExitInitializationMode, unit(h));
}

static void terminate(host *h)
{
    CALL_EITHER(h, fmi2Terminate, fmi3Terminate, unit(h));
}

static void reset(host *h)
{
    CALL_EITHER(h, fmi2Reset, fmi3Reset, unit(h));
}

static void enter_event_mode(host *h)
{
    CALL_EITHER(h, fmi2EnterEventMode, fmi3EnterEventMode, unit(h));
}

static void enter_continuous_time_mode(host *h)
{
    CALL_EITHER(h, fmi2EnterContinuousTimeMode, fmi3EnterContinuousTimeMode, unit(h));
}

static void completed_integrator_step(host *h)
{
    /* fmi2Boolean is the larger one */
    CALL_EITHER(h, fmi2CompletedIntegratorStep, fmi3CompletedIntegratorStep, unit(h), chance(0.5),
                due(exactly(sizeof(fmi2Boolean))), due(exactly(sizeof(fmi2Boolean))));
}

static void set_time(host *h)
{
    double time = chance(0.9) ? h->time + between(-1e-3, 1e-2) : hostile_number();
    CALL_EITHER(h, fmi2SetTime, fmi3SetTime, unit(h), time);
}

/* A length that is rarely wrong, and a vector of that length. */
static double *states(size_t *n)
{
    *n = chance(0.05) ? below(2 * N_STATES + 1) : N_STATES;
    double *x = exactly(*n * sizeof *x);
    for (size_t k = 0; k < *n; k++)
        x[k] = value_for(FIRST_RESULT + (int)(k % (N_STATES + 1)));
    return due(x);
}

static void set_continuous_states(host *h)
{
    size_t n;
    double *x = states(&n);
    CALL_EITHER(h, fmi2SetContinuousStates, fmi3SetContinuousStates, unit(h), x, n);
}

static void get_continuous_states(host *h)
{
    size_t n;
    double *x = states(&n);
    CALL_EITHER(h, fmi2GetContinuousStates, fmi3GetContinuousStates, unit(h), x, n);
}

static void get_derivatives(host *h)
{
    size_t n;
    double *x = states(&n);
    CALL_EITHER(h, fmi2GetDerivatives, fmi3GetContinuousStateDerivatives, unit(h), x, n);
}

static void get_nominals(host *h)
{
    size_t n;
    double *x = states(&n);
    CALL_EITHER(h, fmi2GetNominalsOfContinuousStates, fmi3GetNominalsOfContinuousStates, unit(h), x, n);
}

static void get_event_indicators(host *h)
{
    size_t n = chance(0.7) ? 0 : below(3);
    CALL_EITHER(h, fmi2GetEventIndicators, fmi3GetEventIndicators, unit(h), due(exactly(n * sizeof(double))), n);
}

/* ---- values: FMI 3.0 also takes their number -------------------------------------------------------------------- */

static void get_values(host *h)
{
    choice c = choose(h, ANY_ROLE);
    if (h->version == 2)
        CALL(h, fmi2GetReal, unit(h), c.references, c.n, c.values);
    else
        CALL(h, fmi3GetFloat64, unit(h), c.references, c.n, c.values, c.n_values);
}

static void set_values(host *h)
{
    unsigned roles = ROLE(INPUT);
    if (h->mode & (BEFORE_START | EVENT | STEP))
        roles |= ROLE(TUNABLE_PARAMETER);
    if (h->mode & BEFORE_START)
        roles |= ROLE(STATE) | ROLE(FIXED_PARAMETER);
    choice c = choose(h, roles);
    if (h->version == 2)
        CALL(h, fmi2SetReal, unit(h), c.references, c.n, c.values);
    else
        CALL(h, fmi3SetFloat64, unit(h), c.references, c.n, c.values, c.n_values);
}

static void get_directional_derivative(host *h)
{
    choice unknowns = choose(h, ROLE(STATE) | ROLE(RESULT) | ROLE(DERIVATIVE));
    choice knowns = choose(h, ROLE(INPUT) | ROLE(STATE) | ROLE(FIXED_PARAMETER) | ROLE(TUNABLE_PARAMETER));
    if (h->version == 2)
        CALL(h, fmi2GetDirectionalDerivative, unit(h), unknowns.references, unknowns.n, knowns.references, knowns.n,
             knowns.values, unknowns.values);
    else
        CALL(h, fmi3GetDirectionalDerivative, unit(h), unknowns.references, unknowns.n, knowns.references, knowns.n,
             knowns.values, knowns.n_values, unknowns.values, unknowns.n_values);
}

static void get_output_derivatives(host *h)
{
    choice c = choose(h, ROLE(STATE) | ROLE(RESULT));
    if (h->version == 2)
        CALL(h, fmi2GetRealOutputDerivatives, unit(h), c.references, c.n, c.orders, c.values);
    else
        CALL(h, fmi3GetOutputDerivatives, unit(h), c.references, c.n, c.orders, c.values, c.n_values);
}

const entry COMMON_ACTIONS[] = {
    {set_debug_logging, BETWEEN_CALLS},
    {exit_initialization_mode, INITIALIZATION},
    {exit_initialization_mode, INITIALIZATION}, /* on to where there is more to do */
    {terminate, RUNNING},
    {reset, TERMINATED},
    {enter_event_mode, CONTINUOUS},
    {enter_continuous_time_mode, EVENT},
    {enter_continuous_time_mode, EVENT},
    {enter_continuous_time_mode, EVENT},
    {completed_integrator_step, CONTINUOUS},
    {completed_integrator_step, CONTINUOUS},
    {completed_integrator_step, CONTINUOUS},
    {set_time, EVENT | CONTINUOUS},
    {set_continuous_states, CONTINUOUS},
    {set_continuous_states, CONTINUOUS},
    {set_continuous_states, CONTINUOUS},
    {get_continuous_states, EVENT | CONTINUOUS},
    {get_derivatives, EVENT | CONTINUOUS},
    {get_nominals, BEFORE_START | EVENT},
    {get_event_indicators, EVENT | CONTINUOUS},
    {get_values, ANY_MODE},
    {get_values, ANY_MODE},
    {set_values, BEFORE_START | RUNNING | INTERMEDIATE},
    {set_values, BEFORE_START | RUNNING | INTERMEDIATE},
    {set_values, BEFORE_START | RUNNING | INTERMEDIATE},
    {get_directional_derivative, INITIALIZATION | RUNNING | TERMINATED},
    {get_output_derivatives, STEP | INTERMEDIATE | TERMINATED},
    {NULL, 0},
};
