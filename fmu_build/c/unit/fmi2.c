/* FMI 2.0: the functions of the standard on an instance. Value references are slots. */
#include "fmi2Functions.h"

#include <stdlib.h>
#include <string.h>

#define FMI(name) fmi2##name
#define FMI_STATE(verb, rest) fmi2##verb##FMUstate##rest
#define FMI_DESERIALIZE fmi2DeSerializeFMUstate
#define FMI_GET_DERIVATIVES fmi2GetDerivatives
#include "functions.h"

static int slots_of_reference(uint32_t reference, int *first, int *size)
{
    *first = (int)reference;
    *size = 1;
    return reference < N_SLOTS;
}

static void deliver(const fmi_instance *i, fmi_status status, const char *category, const char *message)
{
    /* `message` is the format and contains no '%' */
    ((fmi2CallbackLogger)i->logger)(i->environment, i->name, AS_FMI(status), category, message);
}

static const fmi_layer FMI_2 = {.token = START.tokens[0], .resolve = slots_of_reference, .deliver = deliver,
                                .discards_as_listed = 1, .tunes_continuously = 1};

/* ---- life cycle ----------------------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    if (!functions)
        return NULL;
    /* memory is from the C library, as modelDescription.xml declares (canNotUseMemoryManagementFunctions) */
    fmi_instance request = {.layer = &FMI_2,
                            .function = __func__,
                            .kind = fmuType == fmi2ModelExchange ? MODEL_EXCHANGE : CO_SIMULATION,
                            .environment = functions->componentEnvironment,
                            .logger = (any_function)functions->logger,
                            .logs = loggingOn != fmi2False,
                            .name = instanceName ? instanceName : ""};
    if (fmuType != fmi2ModelExchange && fmuType != fmi2CoSimulation)
        return report(&request, STATUS_ERROR, "unknown FMU type %d; expected %sCo-Simulation", (int)fmuType,
                      N_STATES > 0 ? "Model Exchange or " : ""), NULL;
    return new_instance(&request, instanceName, fmuGUID);
}

FUNCTION(fmi2SetupExperiment,
         (fmi2Component instance, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
          fmi2Boolean stopTimeDefined, fmi2Real stopTime),
         set_experiment(i, CALL_SET_EXPERIMENT, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime))
FUNCTION(fmi2EnterInitializationMode, (fmi2Component instance),
         change_mode(i, CALL_ENTER_INITIALIZATION, INITIALIZATION, NULL))

/* ---- values --------------------------------------------------------------------------------------------------- */

FUNCTION(fmi2GetReal, (fmi2Component instance, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]),
         get_values(i, vr, nvr, value, ONE_EACH))
FUNCTION(fmi2SetReal, (fmi2Component instance, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]),
         set_values(i, vr, nvr, value, ONE_EACH))

/* Functions of types that no variable has. */
#define NO_VARIABLES(name, type)                                                                                       \
    FUNCTION(name, (fmi2Component instance, const fmi2ValueReference vr[], size_t nvr, type value[]),                  \
             no_such_type(i, nvr))
#define OF_TYPE(name) NO_VARIABLES(fmi2Get##name, fmi2##name) NO_VARIABLES(fmi2Set##name, const fmi2##name)
OF_TYPE(Integer)
OF_TYPE(Boolean)
OF_TYPE(String)

FUNCTION(fmi2GetDirectionalDerivative, (fmi2Component instance, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]),
         differentiate(i, 0, unknowns, n_unknowns, knowns, n_knowns, seed, ONE_EACH, sensitivity, ONE_EACH))

/* ---- model exchange ------------------------------------------------------------------------------------------- */

fmi2Status fmi2NewDiscreteStates(fmi2Component instance, fmi2EventInfo *info)
{
    fmi_instance *i = called(instance, __func__);
    if (!is_allowed(i, CALL_UPDATE_DISCRETE) || !has_array(i, info, 1, "eventInfo"))
        return fmi2Error;
    memset(info, 0, sizeof *info); /* there are no events */
    return fmi2OK;
}

/* ---- co-simulation -------------------------------------------------------------------------------------------- */

FUNCTION(fmi2SetRealInputDerivatives, (fmi2Component instance, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]),
         set_input_rates(i, vr, nvr, order, value))
FUNCTION(fmi2GetRealOutputDerivatives, (fmi2Component instance, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]),
         get_output_rates(i, vr, nvr, order, value, ONE_EACH))
FUNCTION(fmi2DoStep, (fmi2Component instance, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint),
         do_step(i, currentCommunicationPoint, communicationStepSize, NULL))

FUNCTION(fmi2CancelStep, (fmi2Component instance), not_offered(i))

/* fmi2OK if the call is allowed and the requested status is of this type. */
static fmi2Status check_status(fmi_instance *i, int is_of_type, const void *value)
{
    if (!is_allowed(i, CALL_STEP_STATUS) || !has_array(i, value, 1, "value"))
        return fmi2Error;
    if (is_of_type)
        return fmi2OK;
    return AS_FMI(report(i, STATUS_DISCARD, "no such status, since steps are never pending"));
}

/* A function for statuses of a type, of which there may be one that `is_offered`. */
#define STATUS_OF(name, type, is_offered, found)                                                                       \
    fmi2Status name(fmi2Component instance, const fmi2StatusKind s, type *value)                                       \
    {                                                                                                                  \
        fmi_instance *i = called(instance, __func__);                                                                  \
        fmi2Status checked = check_status(i, is_offered, value);                                                       \
        if (checked == fmi2OK)                                                                                         \
            *value = found;                                                                                            \
        return checked;                                                                                                \
    }
STATUS_OF(fmi2GetStatus, fmi2Status, s == fmi2DoStepStatus, AS_FMI(i->step_status))
STATUS_OF(fmi2GetRealStatus, fmi2Real, s == fmi2LastSuccessfulTime, i->last_successful_time)
STATUS_OF(fmi2GetIntegerStatus, fmi2Integer, 0, 0)
/* The unit controls its step size: with the same inputs, a shorter communication step fails at the same point. This stops
   importers that would repeat a discarded step. */
STATUS_OF(fmi2GetBooleanStatus, fmi2Boolean, s == fmi2Terminated, i->step_status == STATUS_DISCARD)
STATUS_OF(fmi2GetStringStatus, fmi2String, 0, NULL)
