/* FMI 3.0: the functions of the standard on an instance. Value references are rows of the variable table, and slots from
   SCALAR_REFERENCE on, for descriptions without arrays. */
#include "fmi3Functions.h"

#include <stdlib.h>
#include <string.h>

#define FMI(name) fmi3##name
#define FMI_STATE(verb, rest) fmi3##verb##FMUState##rest
#define FMI_DESERIALIZE fmi3DeserializeFMUState
#define FMI_GET_DERIVATIVES fmi3GetContinuousStateDerivatives
#include "functions.h"

static int slots_of_reference(uint32_t reference, int *first, int *size)
{
    if (reference >= SCALAR_REFERENCE && reference - SCALAR_REFERENCE < N_SLOTS) {
        *first = (int)(reference - SCALAR_REFERENCE);
        *size = 1;
        return 1;
    }
    if (reference >= N_VARIABLES)
        return 0;
    *first = VARIABLES[reference].first;
    *size = VARIABLES[reference].size;
    return 1;
}

static void deliver(const fmi_instance *i, fmi_status status, const char *category, const char *message)
{
    ((fmi3LogMessageCallback)i->logger)(i->environment, AS_FMI(status), category, message);
}

static const fmi_layer FMI_3 = {.token = START.tokens[1], .resolve = slots_of_reference, .deliver = deliver};

/* ---- life cycle ----------------------------------------------------------------------------------------------- */

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resourcePath,
                                          fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage)
{
    fmi_instance request = {.layer = &FMI_3, .kind = MODEL_EXCHANGE, .environment = environment,
                            .logger = (any_function)logMessage, .logs = loggingOn};
    return new_instance(&request, name, token);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resourcePath,
                                         fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed, const fmi3ValueReference required[],
                                         size_t n_required, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    fmi_instance request = {.layer = &FMI_3, .function = __func__, .kind = CO_SIMULATION, .environment = environment,
                            .logger = (any_function)logMessage, .logs = loggingOn,
                            .intermediate_update = (any_function)intermediateUpdate,
                            .may_return_early = earlyReturnAllowed};
    if (eventModeUsed)
        return report(&request, STATUS_ERROR, "event mode is not offered by this unit (hasEventMode is false)"), NULL;
    if (!has_array(&request, required, n_required, "requiredIntermediateVariables"))
        return NULL;
    for (size_t k = 0; k < n_required; k++) {
        int first, size;
        if (!slots_of_reference(required[k], &first, &size) || variable_of(first)->role > RESULT)
            return report(&request, STATUS_ERROR, "value reference %lu is not available in intermediate updates; expected "
                          "an input or output", (unsigned long)required[k]), NULL;
    }
    return new_instance(&request, name, token);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resourcePath,
                                               fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    fmi_instance request = {.layer = &FMI_3, .function = "instantiation", .environment = environment,
                            .logger = (any_function)logMessage, .logs = loggingOn};
    return report(&request, STATUS_ERROR, "Scheduled Execution is not offered by this unit; it has %sCo-Simulation",
                  N_STATES > 0 ? "Model Exchange and " : ""), NULL;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    fmi_instance *i = called(instance, __func__);
    fmi_status set = set_experiment(i, CALL_ENTER_INITIALIZATION, toleranceDefined, tolerance, startTime, stopTimeDefined,
                                    stopTime);
    return AS_FMI(set == STATUS_OK ? change_mode(i, CALL_ENTER_INITIALIZATION, INITIALIZATION, NULL) : set);
}

/* ---- values --------------------------------------------------------------------------------------------------- */

FUNCTION(fmi3GetFloat64,
         (fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 values[], size_t n),
         get_values(i, vr, nvr, values, n))
FUNCTION(fmi3SetFloat64,
         (fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 values[], size_t n),
         set_values(i, vr, nvr, values, n))

/* A function of a type that no variable has: its vectors are read for no reference. */
#define NO_VARIABLES(name, size, ...)                                                                                  \
    FUNCTION(name, (fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr, __VA_ARGS__),                    \
             no_such_type(i, size))
#define OF_TYPE(name)                                                                                                  \
    NO_VARIABLES(fmi3Get##name, nvr + n, fmi3##name values[], size_t n)                                                \
    NO_VARIABLES(fmi3Set##name, nvr + n, const fmi3##name values[], size_t n)
OF_TYPE(Float32)
OF_TYPE(Int8)
OF_TYPE(UInt8)
OF_TYPE(Int16)
OF_TYPE(UInt16)
OF_TYPE(Int32)
OF_TYPE(UInt32)
OF_TYPE(Int64)
OF_TYPE(UInt64)
OF_TYPE(Boolean)
OF_TYPE(String)
NO_VARIABLES(fmi3GetBinary, nvr + n, size_t sizes[], fmi3Binary values[], size_t n)
NO_VARIABLES(fmi3SetBinary, nvr + n, const size_t sizes[], const fmi3Binary values[], size_t n)

NO_VARIABLES(fmi3GetClock, nvr, fmi3Clock values[])
NO_VARIABLES(fmi3SetClock, nvr, const fmi3Clock values[])
NO_VARIABLES(fmi3GetIntervalDecimal, nvr, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(fmi3SetIntervalDecimal, nvr, const fmi3Float64 intervals[])
NO_VARIABLES(fmi3GetIntervalFraction, nvr, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
             fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(fmi3SetIntervalFraction, nvr, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NO_VARIABLES(fmi3GetShiftDecimal, nvr, fmi3Float64 shifts[])
NO_VARIABLES(fmi3SetShiftDecimal, nvr, const fmi3Float64 shifts[])
NO_VARIABLES(fmi3GetShiftFraction, nvr, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NO_VARIABLES(fmi3SetShiftFraction, nvr, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])

static fmi_status no_dependencies(fmi_instance *i, fmi3ValueReference reference, size_t *n)
{
    int first, size;
    if (!is_allowed(i, CALL_GET) || !has_array(i, n, 1, "nDependencies"))
        return STATUS_ERROR;
    if (!slots_of_reference(reference, &first, &size))
        return report(i, STATUS_ERROR, "no variable has value reference %lu", (unsigned long)reference);
    return report(i, STATUS_ERROR, "dependencies do not change at run time; they are in modelDescription.xml");
}

FUNCTION(fmi3GetNumberOfVariableDependencies, (fmi3Instance instance, fmi3ValueReference reference, size_t *n),
         no_dependencies(i, reference, n))
FUNCTION(fmi3GetVariableDependencies, (fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[],
                                       size_t n),
         no_dependencies(i, dependent, &n))

#define DERIVATIVE_OF(name, is_adjoint)                                                                                \
    FUNCTION(name, (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,                     \
                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,       \
                    fmi3Float64 sensitivity[], size_t n_sensitivity),                                                  \
             differentiate(i, is_adjoint, unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, sensitivity,            \
                           n_sensitivity))
DERIVATIVE_OF(fmi3GetDirectionalDerivative, 0)
DERIVATIVE_OF(fmi3GetAdjointDerivative, 1)

/* ---- events --------------------------------------------------------------------------------------------------- */

FUNCTION(fmi3EvaluateDiscreteStates, (fmi3Instance instance),
         is_allowed(i, CALL_EVALUATE_DISCRETE) ? STATUS_OK : STATUS_ERROR)

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    fmi_instance *i = called(instance, __func__);
    fmi3Boolean *flags[] = {discreteStatesNeedUpdate, terminateSimulation, nominalsOfContinuousStatesChanged,
                            valuesOfContinuousStatesChanged, nextEventTimeDefined};
    int is_complete = is_allowed(i, CALL_UPDATE_DISCRETE) && has_array(i, nextEventTime, 1, "nextEventTime");
    for (int k = 0; is_complete && k < 5; k++)
        is_complete = has_array(i, flags[k], 1, "a flag");
    if (!is_complete)
        return fmi3Error;
    for (int k = 0; k < 5; k++)
        *flags[k] = fmi3False;
    *nextEventTime = 0;
    return fmi3OK;
}

/* ---- model exchange ------------------------------------------------------------------------------------------- */

static fmi_status get_number(fmi_instance *i, size_t *n, size_t number)
{
    if (!is_allowed(i, CALL_GET_NUMBERS) || !has_array(i, n, 1, "the number"))
        return STATUS_ERROR;
    *n = number;
    return STATUS_OK;
}

FUNCTION(fmi3GetNumberOfEventIndicators, (fmi3Instance instance, size_t *n), get_number(i, n, 0))
FUNCTION(fmi3GetNumberOfContinuousStates, (fmi3Instance instance, size_t *n), get_number(i, n, N_STATES))

/* ---- co-simulation -------------------------------------------------------------------------------------------- */

FUNCTION(fmi3GetOutputDerivatives, (fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr,
                                    const fmi3Int32 orders[], fmi3Float64 values[], size_t n),
         get_output_rates(i, vr, nvr, orders, values, n))

/* After an internal step: the importer can read results, set inputs and request an early return. */
static void intermediate_update(void *context, double time, double *end)
{
    fmi_instance *i = context;
    fmi3Boolean early_return = fmi3False;
    fmi3Float64 return_time = time;
    i->mode = INTERMEDIATE;
    ((fmi3IntermediateUpdateCallback)i->intermediate_update)(i->environment, time, fmi3True, fmi3True, fmi3True,
                                                             i->may_return_early && time < *end, &early_return,
                                                             &return_time);
    i->mode = STEP;
    if (i->may_return_early && early_return && return_time < *end) /* not if it is NaN */
        *end = return_time > time ? return_time : time;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    fmi_instance *i = called(instance, __func__);
    if (!i || !has_array(i, eventHandlingNeeded, 1, "eventHandlingNeeded") ||
        !has_array(i, terminateSimulation, 1, "terminateSimulation") || !has_array(i, earlyReturn, 1, "earlyReturn") ||
        !has_array(i, lastSuccessfulTime, 1, "lastSuccessfulTime"))
        return fmi3Error;
    step_observer observer = {i, intermediate_update};
    double end = currentCommunicationPoint + communicationStepSize;
    fmi_status stepped = do_step(i, currentCommunicationPoint, communicationStepSize,
                                 i->intermediate_update ? &observer : NULL);
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = fmi3False;
    *earlyReturn = stepped == STATUS_OK && i->last_successful_time < end;
    *lastSuccessfulTime = i->last_successful_time;
    return AS_FMI(stepped);
}

/* ---- not offered: clocked partitions, step mode after events, structural parameters ---------------------------- */

FUNCTION(fmi3ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time),
         not_offered(i))
FUNCTION(fmi3EnterStepMode, (fmi3Instance instance), not_offered(i))
FUNCTION(fmi3EnterConfigurationMode, (fmi3Instance instance), not_offered(i))
FUNCTION(fmi3ExitConfigurationMode, (fmi3Instance instance), not_offered(i))
