/* Actions of FMI 2.0. */
#include <string.h>

#include "fuzz.h"

/* A name, a token, and whether they are right. */
static const char *any_name(int *is_right)
{
    if (chance(0.95))
        return chance(0.9) ? "plant" : "100%n%s";
    *is_right = 0;
    return (const char *[]){NULL, "", " \t\n"}[below(3)];
}

static const char *any_token(int *is_right)
{
    static const char *const wrong[] = {NULL, "", "hosts", "{host}", "%s%n%s%n"};
    if (chance(0.95))
        return RIGHT_TOKEN;
    *is_right = 0;
    if (chance(0.7))
        return wrong[below(5)];
    char *longest = exactly(2000);
    memset(longest, '%', 1999);
    return longest;
}

void *instantiate_fmi2(host *h)
{
    require(strcmp(fmi2GetVersion(), "2.0") == 0, "the version is that of the standard");
    require(strcmp(fmi2GetTypesPlatform(), "default") == 0, "the types are the default ones");
    int is_right = 1, loggingOn = chance(0.8);
    fmi2CallbackFunctions *functions = exactly(sizeof *functions);
    *functions = (fmi2CallbackFunctions){.componentEnvironment = h};
    h->has_logger = chance(0.9);
    if (h->has_logger)
        functions->logger = logger_of_fmi2;
    h->logging = h->has_logger ? ALL_CATEGORIES : SILENT; /* until it is there: why it is not, is always told */
    const char *name = any_name(&is_right), *token = any_token(&is_right);
    h->name = name ? name : "";
    int type = h->kind == MODEL_EXCHANGE ? fmi2ModelExchange : fmi2CoSimulation;
    is_right = is_right && (h->kind == CO_SIMULATION || N_STATES > 0);
    if (chance(0.01)) {
        type = 7;
        is_right = 0;
    }
    if (chance(0.01)) {
        functions = NULL;
        is_right = 0;
    }
    void *made = fmi2Instantiate(name, (fmi2Type)type, token, chance(0.5) ? NULL : "file:///x", functions,
                                 chance(0.5), loggingOn);
    require((made != NULL) == is_right, "there is an instance where name, token, kind and callbacks are right");
    if (!loggingOn)
        h->logging = SILENT;
    count_call("fmi2GetVersion", OK);
    count_call("fmi2GetTypesPlatform", OK);
    count_call("fmi2Instantiate", made ? OK : ERROR);
    return made;
}

static void setup_experiment(host *h)
{
    double start = chance(0.9) ? between(0, 2) : hostile_number(), stop = start + between(0, 3);
    double tolerance = chance(0.9) ? pow(10, between(-10, -4)) : hostile_number();
    CALL(h, fmi2SetupExperiment, unit(h), chance(0.5), tolerance, start, chance(0.1), chance(0.9) ? stop : -stop);
}

static void enter_initialization_mode(host *h)
{
    CALL(h, fmi2EnterInitializationMode, unit(h));
}

/* There are no variables of other types. */
#define OTHER_TYPE(name, function, type)                                                                               \
    static void name(host *h)                                                                                          \
    {                                                                                                                  \
        size_t n = below(3);                                                                                           \
        fmi2ValueReference *references = exactly(n * sizeof *references);                                              \
        type *values = exactly(n * sizeof *values);                                                                    \
        int status = CALL(h, function, unit(h), due(references), n, due(values));                                      \
        require((status != OK) || n == 0, "there are variables of no other type");                                     \
    }
OTHER_TYPE(get_integer, fmi2GetInteger, fmi2Integer)
OTHER_TYPE(get_boolean, fmi2GetBoolean, fmi2Boolean)
OTHER_TYPE(get_string, fmi2GetString, fmi2String)
OTHER_TYPE(set_integer, fmi2SetInteger, fmi2Integer)
OTHER_TYPE(set_boolean, fmi2SetBoolean, fmi2Boolean)
OTHER_TYPE(set_string, fmi2SetString, fmi2String)

static void new_discrete_states(host *h)
{
    CALL(h, fmi2NewDiscreteStates, unit(h), due(exactly(sizeof(fmi2EventInfo))));
}

static void set_input_derivatives(host *h)
{
    choice c = choose(h, ROLE(INPUT));
    CALL(h, fmi2SetRealInputDerivatives, unit(h), c.references, c.n, c.orders, c.values);
}

static void do_step(host *h)
{
    double point = communication_point(h), step = step_size();
    if (CALL(h, fmi2DoStep, unit(h), point, step, chance(0.5)) == OK)
        require(h->time == point + step, "the step ends where it should");
}

static void cancel_step(host *h)
{
    CALL(h, fmi2CancelStep, unit(h));
}

static fmi2StatusKind any_status_kind(void)
{
    return (fmi2StatusKind)below(5);
}

/* A status of this type; `holds` says what is to be of its value. */
#define STATUS(name, function, type, holds)                                                                            \
    static void name(host *h)                                                                                          \
    {                                                                                                                  \
        type *value = exactly(sizeof *value);                                                                          \
        if (CALL(h, function, unit(h), any_status_kind(), due(value)) == OK)                                           \
            require(holds, #function);                                                                                 \
    }
STATUS(get_status, fmi2GetStatus, fmi2Status, (int)*value >= OK && *value <= fmi2Fatal)
STATUS(get_real_status, fmi2GetRealStatus, fmi2Real, *value == h->time)
STATUS(get_integer_status, fmi2GetIntegerStatus, fmi2Integer, 0)
STATUS(get_boolean_status, fmi2GetBooleanStatus, fmi2Boolean, *value == 0 || *value == 1)
STATUS(get_string_status, fmi2GetStringStatus, fmi2String, 0)

const entry FMI2_ACTIONS[] = {
    {setup_experiment, INSTANTIATED},
    {enter_initialization_mode, INSTANTIATED},
    {enter_initialization_mode, INSTANTIATED},
    {get_integer, 0},
    {get_boolean, 0},
    {get_string, 0},
    {set_integer, 0},
    {set_boolean, 0},
    {set_string, 0},
    {new_discrete_states, EVENT},
    {set_input_derivatives, BEFORE_START | STEP},
    {do_step, STEP},
    {do_step, STEP},
    {do_step, STEP},
    {do_step, STEP},
    {cancel_step, 0},
    {get_status, STEP},
    {get_real_status, STEP | TERMINATED},
    {get_integer_status, STEP},
    {get_boolean_status, STEP},
    {get_string_status, STEP},
    {NULL, 0},
};
