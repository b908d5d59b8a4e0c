/* The functions that FMI 2.0 and 3.0 have in common. A layer includes this file once, after

   FMI(name)               fmi2name or fmi3name: the prefix of the version
   FMI_STATE(verb, rest)   its names of the functions for saved states
   FMI_DESERIALIZE, FMI_GET_DERIVATIVES   functions that it names in another way */
#include "instance.h"

/* the standard's functions have arguments that this unit does not need */
#pragma GCC diagnostic ignored "-Wunused-parameter"

#define AS_FMI(status) ((FMI(Status))(status))

static inline fmi_instance *called(void *instance, const char *function)
{
    fmi_instance *i = instance;
    if (i)
        i->function = function;
    return i;
}

/* A function of the standard that returns a status; its argument `instance` is i in the expression for that. */
#define FUNCTION(name, arguments, status)                                                                              \
    FMI(Status) name arguments                                                                                         \
    {                                                                                                                  \
        fmi_instance *i = called(instance, __func__);                                                                  \
        return AS_FMI(status);                                                                                         \
    }

const char *FMI(GetVersion)(void) { return FMI(Version); }

static fmi_status not_offered(fmi_instance *i)
{
    is_allowed(i, CALL_NOT_OFFERED);
    return STATUS_ERROR;
}

/* ---- life cycle ----------------------------------------------------------------------------------------------- */

FUNCTION(FMI(SetDebugLogging), (void *instance, FMI(Boolean) loggingOn, size_t n, const FMI(String) categories[]),
         set_logging(i, loggingOn, n, categories))

void FMI(FreeInstance)(void *instance) { free(instance); }

FUNCTION(FMI(ExitInitializationMode), (void *instance),
         change_mode(i, CALL_EXIT_INITIALIZATION, i && i->kind == MODEL_EXCHANGE ? EVENT : STEP, component_begin))
FUNCTION(FMI(Terminate), (void *instance), change_mode(i, CALL_TERMINATE, TERMINATED, NULL))
FUNCTION(FMI(Reset), (void *instance), is_allowed(i, CALL_RESET) ? begin_anew(i) : STATUS_ERROR)

/* ---- saved states --------------------------------------------------------------------------------------------- */

FUNCTION(FMI_STATE(Get, ), (void *instance, void **saved), save_state(i, saved))
FUNCTION(FMI_STATE(Set, ), (void *instance, void *saved), restore_state(i, saved))
FUNCTION(FMI_STATE(Free, ), (void *instance, void **saved), free_state(i, saved))
FUNCTION(FMI_STATE(Serialized, Size), (void *instance, void *saved, size_t *size), serialized_size(i, saved, size))
FUNCTION(FMI_STATE(Serialize, ), (void *instance, void *saved, FMI(Byte) bytes[], size_t size),
         serialize(i, saved, (unsigned char *)bytes, size))
FUNCTION(FMI_DESERIALIZE, (void *instance, const FMI(Byte) bytes[], size_t size, void **saved),
         deserialize(i, (const unsigned char *)bytes, size, saved))

/* ---- model exchange ------------------------------------------------------------------------------------------- */

FUNCTION(FMI(EnterEventMode), (void *instance), change_mode(i, CALL_ENTER_EVENT, EVENT, NULL))
FUNCTION(FMI(EnterContinuousTimeMode), (void *instance),
         change_mode(i, CALL_ENTER_CONTINUOUS, CONTINUOUS, component_check_parameters))

/* The simulation must end when the pose is beyond the limits. */
FMI(Status) FMI(CompletedIntegratorStep)(void *instance, FMI(Boolean) noSetFMUStatePriorToCurrentPoint,
                                         FMI(Boolean) *enterEventMode, FMI(Boolean) *terminateSimulation)
{
    fmi_instance *i = called(instance, __func__);
    if (!i || !has_array(i, enterEventMode, 1, "enterEventMode") ||
        !has_array(i, terminateSimulation, 1, "terminateSimulation"))
        return FMI(Error);
    *enterEventMode = *terminateSimulation = FMI(False);
    if (change_mode(i, CALL_COMPLETED_STEP, CONTINUOUS, component_check_parameters) != STATUS_OK)
        return FMI(Error);
    *terminateSimulation = component_check_state(i->core) != DONE;
    if (*terminateSimulation)
        report(i, STATUS_OK, "the simulation must end: %s", component_message(i->core));
    return FMI(OK);
}

FUNCTION(FMI(SetTime), (void *instance, double time),
         is_allowed(i, CALL_SET_TIME) ? conclude(i, CALL_SET_TIME, component_set_time(i->core, time)) : STATUS_ERROR)

FMI(Status) FMI(SetContinuousStates)(void *instance, const double x[], size_t n)
{
    fmi_instance *i = called(instance, __func__);
    if (!has_states(i, CALL_SET_CONTINUOUS_STATES, x, n))
        return FMI(Error);
    outcome checked = DONE;
    for (int k = 0; k < N_STATES && checked == DONE; k++)
        checked = component_check(i->core, FIRST_STATE + k, x[k]);
    for (int k = 0; k < N_STATES && checked == DONE; k++)
        component_put(i->core, FIRST_STATE + k, x[k]);
    return AS_FMI(conclude(i, CALL_SET_CONTINUOUS_STATES, checked));
}

FMI(Status) FMI(GetContinuousStates)(void *instance, double x[], size_t n)
{
    fmi_instance *i = called(instance, __func__);
    if (!has_states(i, CALL_GET_CONTINUOUS_STATES, x, n))
        return FMI(Error);
    for (int k = 0; k < N_STATES; k++)
        component_get(i->core, FIRST_STATE + k, x + k);
    return FMI(OK);
}

FUNCTION(FMI_GET_DERIVATIVES, (void *instance, double derivatives[], size_t n),
         has_states(i, CALL_GET_CONTINUOUS_STATES, derivatives, n)
             ? conclude(i, CALL_GET_CONTINUOUS_STATES, component_derivatives(i->core, derivatives))
             : STATUS_ERROR)

FMI(Status) FMI(GetNominalsOfContinuousStates)(void *instance, double nominals[], size_t n)
{
    fmi_instance *i = called(instance, __func__);
    if (!has_states(i, CALL_GET_CONTINUOUS_STATES, nominals, n))
        return FMI(Error);
    memcpy(nominals, NOMINAL_STATES, sizeof(double) * N_STATES);
    return FMI(OK);
}

FUNCTION(FMI(GetEventIndicators), (void *instance, double indicators[], size_t n),
         is_allowed(i, CALL_GET_CONTINUOUS_STATES) && has_length(i, n, 0, "event indicators") ? STATUS_OK
                                                                                              : STATUS_ERROR)
