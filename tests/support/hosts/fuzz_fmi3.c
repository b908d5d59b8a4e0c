/* Actions of FMI 3.0, and what its importers do in the callback of a step. */
#include <string.h>

#include "fuzz.h"

/* ---- life ----------------------------------------------------------------------------------------------------- */

static void intermediate_update(fmi3InstanceEnvironment environment, fmi3Float64 time, fmi3Boolean sets_requested,
                                fmi3Boolean gets_allowed, fmi3Boolean step_finished, fmi3Boolean can_return_early,
                                fmi3Boolean *early_return_requested, fmi3Float64 *early_return_time)
{
    host *h = environment;
    double before = h->time;
    h->mode = INTERMEDIATE;
    h->time = time_of(h);
    require(h->time == time, "the intermediate update is told of the present time");
    require(time > before, "time goes on from one intermediate update to the next");
    require(sets_requested && gets_allowed && step_finished, "after an internal step all is allowed");
    for (size_t n = chance(0.2) ? below(3) : 0; n > 0; n--)
        act_in_callback(h);
    /* also when it is not allowed: then it is not heeded */
    if (chance(can_return_early ? 0.1 : 0.02)) {
        *early_return_requested = fmi3True;
        *early_return_time = chance(0.8) ? time + between(0, 0.01) : chance(0.5) ? time - 1 : hostile_number();
    }
    h->mode = STEP;
}

static const char *any_token(int *is_right)
{
    if (chance(0.97))
        return RIGHT_TOKEN;
    *is_right = 0;
    return (const char *[]){NULL, "", "hosts", "%s%n"}[below(4)];
}

static void refuse_scheduled_execution(host *h)
{
    void *made = fmi3InstantiateScheduledExecution("plant", RIGHT_TOKEN, NULL, fmi3False, fmi3True, h,
                                                   h->has_logger ? logger_of_fmi3 : NULL, NULL, NULL, NULL);
    require(made == NULL, "there is no scheduled execution");
    count_call("fmi3InstantiateScheduledExecution", ERROR);
}

void *instantiate_fmi3(host *h)
{
    require(strncmp(fmi3GetVersion(), "3.0", 3) == 0, "the version is that of the standard");
    count_call("fmi3GetVersion", OK);
    int is_right = 1, loggingOn = chance(0.8);
    h->has_logger = chance(0.9);
    h->logging = h->has_logger ? ALL_CATEGORIES : SILENT; /* until it is there: why it is not, is always told */
    fmi3LogMessageCallback logger = h->has_logger ? logger_of_fmi3 : NULL;
    const char *name = chance(0.97) ? "plant" : NULL, *token = any_token(&is_right);
    h->name = "plant";
    is_right = is_right && name;
    if (chance(0.02))
        refuse_scheduled_execution(h);
    void *made;
    if (h->kind == MODEL_EXCHANGE) {
        is_right = is_right && N_STATES > 0;
        made = fmi3InstantiateModelExchange(name, token, NULL, chance(0.5), loggingOn, h, logger);
        count_call("fmi3InstantiateModelExchange", made ? OK : ERROR);
    } else {
        int event_mode_used = chance(0.02);
        size_t n = below(4);
        fmi3ValueReference *references = exactly(n * sizeof *references);
        for (size_t k = 0; k < n; k++) {
            references[k] = (fmi3ValueReference)below((size_t)FIRST_PARAMETER_ROW); /* inputs and results come first */
            if (chance(0.02)) {
                references[k] = (const fmi3ValueReference[]){FIRST_PARAMETER_ROW, VARIABLE_OF_SLOT[TIME], N_VARIABLES, UINT32_MAX}[below(4)];
                is_right = 0;
            }
        }
        fmi3ValueReference *given = due(references);
        is_right = is_right && !event_mode_used && (given || n == 0);
        made = fmi3InstantiateCoSimulation(name, token, NULL, chance(0.5), loggingOn, event_mode_used, chance(0.5),
                                           given, n, h, logger, chance(0.8) ? intermediate_update : NULL);
        count_call("fmi3InstantiateCoSimulation", made ? OK : ERROR);
    }
    require((made != NULL) == is_right, "there is an instance where name, token and options are right");
    if (!loggingOn)
        h->logging = SILENT;
    return made;
}

static void enter_initialization_mode(host *h)
{
    double start = chance(0.95) ? between(0, 2) : hostile_number(), stop = start + between(0, 3);
    double tolerance = chance(0.95) ? pow(10, between(-10, -4)) : hostile_number();
    CALL(h, fmi3EnterInitializationMode, unit(h), chance(0.5), tolerance, start, chance(0.1),
         chance(0.9) ? stop : -stop);
}

/* ---- values --------------------------------------------------------------------------------------------------- */

/* There are no variables of other types. */
#define OTHER_TYPE(name, function, type)                                                                               \
    static void name(host *h)                                                                                          \
    {                                                                                                                  \
        size_t n = below(3), n_values = chance(0.8) ? n : below(3);                                                    \
        fmi3ValueReference *references = exactly(n * sizeof *references);                                              \
        type *values = exactly(n_values * sizeof *values);                                                             \
        int status = CALL(h, function, unit(h), due(references), n, due(values), n_values);                            \
        require(status != OK || n == 0, "there are variables of no other type");                                       \
    }
#define OTHER_TYPE_BOTH_WAYS(type)                                                                                     \
    OTHER_TYPE(get_##type, fmi3Get##type, fmi3##type)                                                                  \
    OTHER_TYPE(set_##type, fmi3Set##type, fmi3##type)
OTHER_TYPE_BOTH_WAYS(Float32)
OTHER_TYPE_BOTH_WAYS(Int8)
OTHER_TYPE_BOTH_WAYS(UInt8)
OTHER_TYPE_BOTH_WAYS(Int16)
OTHER_TYPE_BOTH_WAYS(UInt16)
OTHER_TYPE_BOTH_WAYS(Int32)
OTHER_TYPE_BOTH_WAYS(UInt32)
OTHER_TYPE_BOTH_WAYS(Int64)
OTHER_TYPE_BOTH_WAYS(UInt64)
OTHER_TYPE_BOTH_WAYS(Boolean)
OTHER_TYPE_BOTH_WAYS(String)

/* Of binaries and clocks: arrays of `n` each. */
#define OF_CLOCKS(name, function, ...)                                                                                 \
    static void name(host *h)                                                                                          \
    {                                                                                                                  \
        size_t n = below(3);                                                                                           \
        CALL(h, function, unit(h), due(exactly(n * sizeof(fmi3ValueReference))), n, __VA_ARGS__);                      \
    }
#define ARRAY(type) due(exactly(n * sizeof(type)))
OF_CLOCKS(get_binary, fmi3GetBinary, ARRAY(size_t), ARRAY(fmi3Binary), n)
OF_CLOCKS(set_binary, fmi3SetBinary, ARRAY(size_t), ARRAY(fmi3Binary), n)
OF_CLOCKS(get_clock, fmi3GetClock, ARRAY(fmi3Clock))
OF_CLOCKS(set_clock, fmi3SetClock, ARRAY(fmi3Clock))
OF_CLOCKS(get_interval_decimal, fmi3GetIntervalDecimal, ARRAY(fmi3Float64), ARRAY(fmi3IntervalQualifier))
OF_CLOCKS(get_interval_fraction, fmi3GetIntervalFraction, ARRAY(fmi3UInt64), ARRAY(fmi3UInt64),
          ARRAY(fmi3IntervalQualifier))
OF_CLOCKS(get_shift_decimal, fmi3GetShiftDecimal, ARRAY(fmi3Float64))
OF_CLOCKS(get_shift_fraction, fmi3GetShiftFraction, ARRAY(fmi3UInt64), ARRAY(fmi3UInt64))
OF_CLOCKS(set_interval_decimal, fmi3SetIntervalDecimal, ARRAY(fmi3Float64))
OF_CLOCKS(set_interval_fraction, fmi3SetIntervalFraction, ARRAY(fmi3UInt64), ARRAY(fmi3UInt64))
OF_CLOCKS(set_shift_decimal, fmi3SetShiftDecimal, ARRAY(fmi3Float64))
OF_CLOCKS(set_shift_fraction, fmi3SetShiftFraction, ARRAY(fmi3UInt64), ARRAY(fmi3UInt64))

static fmi3ValueReference any_reference(void)
{
    return chance(0.9) ? (fmi3ValueReference)below(N_VARIABLES) : UINT32_MAX;
}

static void get_number_of_variable_dependencies(host *h)
{
    CALL(h, fmi3GetNumberOfVariableDependencies, unit(h), any_reference(), due(exactly(sizeof(size_t))));
}

static void get_variable_dependencies(host *h)
{
    size_t n = below(3);
    CALL(h, fmi3GetVariableDependencies, unit(h), any_reference(), ARRAY(size_t), ARRAY(fmi3ValueReference),
         ARRAY(size_t), ARRAY(fmi3DependencyKind), n);
}

/* ---- sensitivities -------------------------------------------------------------------------------------------- */

static void get_adjoint_derivative(host *h)
{
    choice unknowns = choose(h, ROLE(STATE) | ROLE(RESULT) | ROLE(DERIVATIVE));
    choice knowns = choose(h, ROLE(INPUT) | ROLE(STATE) | ROLE(FIXED_PARAMETER) | ROLE(TUNABLE_PARAMETER));
    CALL(h, fmi3GetAdjointDerivative, unit(h), unknowns.references, unknowns.n, knowns.references, knowns.n,
         unknowns.values, unknowns.n_values, knowns.values, knowns.n_values);
}

/* ---- model exchange ------------------------------------------------------------------------------------------- */

static void evaluate_discrete_states(host *h)
{
    CALL(h, fmi3EvaluateDiscreteStates, unit(h));
}

static void update_discrete_states(host *h)
{
    size_t n = 1;
    CALL(h, fmi3UpdateDiscreteStates, unit(h), ARRAY(fmi3Boolean), ARRAY(fmi3Boolean), ARRAY(fmi3Boolean),
         ARRAY(fmi3Boolean), ARRAY(fmi3Boolean), ARRAY(fmi3Float64));
}

static void get_number_of_event_indicators(host *h)
{
    size_t *n = exactly(sizeof *n);
    if (CALL(h, fmi3GetNumberOfEventIndicators, unit(h), due(n)) == OK)
        require(*n == 0, "there are no event indicators");
}

static void get_number_of_continuous_states(host *h)
{
    size_t *n = exactly(sizeof *n);
    if (CALL(h, fmi3GetNumberOfContinuousStates, unit(h), due(n)) == OK)
        require(*n == N_STATES, "the continuous states are those of the table");
}

/* ---- co-simulation -------------------------------------------------------------------------------------------- */

static void do_step(host *h)
{
    double point = communication_point(h), step = step_size();
    fmi3Boolean *flags[3];
    for (int k = 0; k < 3; k++)
        flags[k] = exactly(sizeof *flags[k]);
    fmi3Float64 *reached = exactly(sizeof *reached);
    int status = CALL(h, fmi3DoStep, unit(h), point, step, chance(0.5), due(flags[0]), due(flags[1]), due(flags[2]),
                      due(reached));
    h->mode = status == OK ? STEP : h->mode;
    if (status != OK)
        return;
    require(*reached == h->time, "the last successful time is the present one");
    require(!*flags[0] && !*flags[1], "a step asks for nothing");
    require(*flags[2] ? h->time < point + step : h->time == point + step,
            "a step that is not cut ends where it should");
}

/* ---- what the unit has not ------------------------------------------------------------------------------------ */

static void enter_step_mode(host *h)
{
    CALL(h, fmi3EnterStepMode, unit(h));
}

static void enter_configuration_mode(host *h)
{
    CALL(h, fmi3EnterConfigurationMode, unit(h));
}

static void exit_configuration_mode(host *h)
{
    CALL(h, fmi3ExitConfigurationMode, unit(h));
}

static void activate_model_partition(host *h)
{
    CALL(h, fmi3ActivateModelPartition, unit(h), any_reference(), h->time);
}

#define BOTH_WAYS(name) {get_##name, 0}, {set_##name, 0}
const entry FMI3_ACTIONS[] = {
    {enter_initialization_mode, INSTANTIATED},
    {enter_initialization_mode, INSTANTIATED},
    {get_adjoint_derivative, INITIALIZATION | RUNNING | TERMINATED},
    {evaluate_discrete_states, INITIALIZATION | EVENT},
    {update_discrete_states, EVENT},
    {get_number_of_event_indicators, EVENT},
    {get_number_of_continuous_states, EVENT},
    {do_step, STEP},
    {do_step, STEP},
    {do_step, STEP},
    {do_step, STEP},
    BOTH_WAYS(Float32), BOTH_WAYS(Int8), BOTH_WAYS(UInt8), BOTH_WAYS(Int16), BOTH_WAYS(UInt16), BOTH_WAYS(Int32),
    BOTH_WAYS(UInt32), BOTH_WAYS(Int64), BOTH_WAYS(UInt64), BOTH_WAYS(Boolean), BOTH_WAYS(String), BOTH_WAYS(binary),
    BOTH_WAYS(clock), BOTH_WAYS(interval_decimal), BOTH_WAYS(interval_fraction), BOTH_WAYS(shift_decimal),
    BOTH_WAYS(shift_fraction),
    {get_number_of_variable_dependencies, 0}, {get_variable_dependencies, 0}, {enter_step_mode, 0},
    {enter_configuration_mode, 0}, {exit_configuration_mode, 0}, {activate_model_partition, 0},
    {NULL, 0},
};
