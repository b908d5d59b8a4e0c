/* An instance of the unit, independent of the FMI version: a component with its mode and its log.

   Functions with an argument `function` implement the FMI function of that name: they check whether the call is
   allowed, check its arguments, and log errors. A call that does not return STATUS_OK changes nothing. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

#include "component.h"
#include "model.h"

/* ---- modes and calls ------------------------------------------------------------------------------------------ */

typedef enum { MODEL_EXCHANGE = 1, CO_SIMULATION = 2 } fmi_kind;

typedef enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    EVENT = 4,       /* model exchange */
    CONTINUOUS = 8,  /* model exchange: "continuous-time mode" */
    STEP = 16,       /* co-simulation: "step mode", in FMI 2.0 "slave initialized" */
    INTERMEDIATE = 32, /* co-simulation, FMI 3.0: in the callback of a step */
    TERMINATED = 64
} fmi_mode;

#define BEFORE_START (INSTANTIATED | INITIALIZATION)
#define RUNNING (EVENT | CONTINUOUS | STEP)
#define BETWEEN_CALLS (BEFORE_START | RUNNING | TERMINATED)
#define ANY_MODE (BETWEEN_CALLS | INTERMEDIATE)
#define NEVER 0
/* a component without continuous states has nothing to integrate, and its outputs have no derivatives */
#define IF_CONTINUOUS(modes) (N_STATES > 0 ? (modes) : NEVER)

#define FOR_ME MODEL_EXCHANGE
#define FOR_CS CO_SIMULATION
#define BOTH (FOR_ME | FOR_CS)

/* The ONE table of allowed calls by kind and mode of the instance, for FMI 2.0 and 3.0; and of the kinds for which a
   call may return Discard in FMI 2.0, which lists the functions (2.1.3). In FMI 3.0 every function may.
   Call, allowed for these kinds, may return Discard for these kinds, allowed in these modes: */
#define CALLS(ROW)                                                                                               \
    ROW(CALL_SET_LOGGING,           BOTH,      NEVER,  BETWEEN_CALLS)                                            \
    ROW(CALL_RESET,                 BOTH,      NEVER,  BETWEEN_CALLS)                                            \
    ROW(CALL_FMU_STATE,             BOTH,      NEVER,  BETWEEN_CALLS)                                            \
    ROW(CALL_SET_EXPERIMENT,        BOTH,      NEVER,  INSTANTIATED)                                             \
    ROW(CALL_ENTER_INITIALIZATION,  BOTH,      NEVER,  INSTANTIATED)                                             \
    ROW(CALL_EXIT_INITIALIZATION,   BOTH,      NEVER,  INITIALIZATION)                                           \
    ROW(CALL_TERMINATE,             BOTH,      NEVER,  RUNNING)                                                  \
    ROW(CALL_GET,                   BOTH,      FOR_ME, ANY_MODE)                                                 \
    ROW(CALL_SET,                   BOTH,      BOTH,   BEFORE_START | RUNNING | INTERMEDIATE)                    \
    ROW(CALL_SET_START,             BOTH,      BOTH,   BEFORE_START)                                             \
    ROW(CALL_SET_TUNABLE,           BOTH,      BOTH,   BEFORE_START | EVENT | STEP)                              \
    ROW(CALL_SENSITIVITY,           BOTH,      NEVER,  IF_CONTINUOUS(INITIALIZATION | RUNNING | TERMINATED))     \
    ROW(CALL_SET_INPUT_RATES,       FOR_CS,    NEVER,  BEFORE_START | STEP)                                      \
    ROW(CALL_GET_OUTPUT_RATES,      FOR_CS,    NEVER,  IF_CONTINUOUS(STEP | INTERMEDIATE | TERMINATED))          \
    ROW(CALL_DO_STEP,               FOR_CS,    FOR_CS, STEP)                                                     \
    ROW(CALL_STEP_STATUS,           FOR_CS,    FOR_CS, STEP | TERMINATED)                                        \
    ROW(CALL_ENTER_EVENT,           FOR_ME,    NEVER,  CONTINUOUS)                                               \
    ROW(CALL_UPDATE_DISCRETE,       FOR_ME,    NEVER,  EVENT)                                                    \
    ROW(CALL_ENTER_CONTINUOUS,      FOR_ME,    NEVER,  EVENT)                                                    \
    ROW(CALL_COMPLETED_STEP,        FOR_ME,    NEVER,  CONTINUOUS)                                               \
    ROW(CALL_SET_TIME,              FOR_ME,    NEVER,  EVENT | CONTINUOUS)                                       \
    ROW(CALL_SET_CONTINUOUS_STATES, FOR_ME,    FOR_ME, CONTINUOUS)                                               \
    ROW(CALL_GET_CONTINUOUS_STATES, FOR_ME,    FOR_ME, BEFORE_START | EVENT | CONTINUOUS | TERMINATED)           \
    ROW(CALL_GET_NUMBERS,           FOR_ME,    NEVER,  BEFORE_START | EVENT | CONTINUOUS)                        \
    ROW(CALL_EVALUATE_DISCRETE,     FOR_ME,    NEVER,  INITIALIZATION | EVENT)                                   \
    /* there are no clocks, no structural parameters, no asynchronous steps */                                   \
    ROW(CALL_NOT_OFFERED,           BOTH,      NEVER,  NEVER)

#define AS_NAME(name, kinds, discards, modes) name,
typedef enum { CALLS(AS_NAME) NUMBER_OF_CALLS } fmi_call;
#undef AS_NAME

/* ---- instances ------------------------------------------------------------------------------------------------ */

/* The same numbers as fmi2Status and fmi3Status. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL } fmi_status;

typedef struct fmi_instance fmi_instance;

/* The differences between the FMI versions. */
typedef struct {
    const char *token; /* the same as in modelDescription.xml; empty if the library is not for this version */
    /* slots of a value reference; 0 if there is no such variable */
    int (*resolve)(uint32_t reference, int *first, int *size);
    int discards_as_listed; /* Discard only where the table allows it */
    /* tunable parameters can be set in continuous-time mode, as CasADi does; FMI 3.0 requires an error */
    int tunes_continuously;
    void (*deliver)(const fmi_instance *i, fmi_status status, const char *category, const char *message);
} fmi_layer;

typedef void (*any_function)(void);

struct fmi_instance {
    component *core; /* after the instance, in the same allocation */
    fmi_kind kind;
    fmi_mode mode;
    const fmi_layer *layer;
    /* from the importer */
    void *environment;
    any_function logger;
    any_function intermediate_update; /* FMI 3.0 */
    int may_return_early;             /* FMI 3.0 */
    int logs;
    unsigned categories; /* one bit each */
    /* of the last step, for FMI 2.0 */
    fmi_status step_status;
    double last_successful_time;
    const char *name; /* after the core */
};

INTERNAL_BEGIN
/* An initialised copy of `request`, which holds the importer's arguments; NULL if token or name are wrong. */
fmi_instance *new_instance(const fmi_instance *request, const char *name, const char *token);

fmi_status report(const fmi_instance *i, fmi_status status, const char *format, ...);
const char *name_of_kind(fmi_kind kind);
int allows(const fmi_instance *i, fmi_call call);
/* 1 if the instance exists and the call is allowed in its mode; logs an error if not. */
int is_allowed(const fmi_instance *i, const char *function, fmi_call call);
/* The status for a component's outcome; logs its message. */
fmi_status conclude(const fmi_instance *i, const char *function, fmi_call call, outcome result);
/* 0 if the array is NULL but has `n` > 0 elements; logs an error. */
int has_array(const fmi_instance *i, const char *function, const void *array, size_t n, const char *name);
int has_length(const fmi_instance *i, const char *function, size_t found, size_t expected, const char *name);
/* For functions of the state vector: whether the call is allowed, with N_STATES elements. */
int has_states(const fmi_instance *i, const char *function, fmi_call call, const void *x, size_t n);

fmi_status set_logging(fmi_instance *i, const char *function, int on, size_t n, const char *const categories[]);

/* FMI 2.0 does not pass the length of the value array: one value per reference. */
#define ONE_EACH SIZE_MAX

fmi_status get_values(fmi_instance *i, const char *function, const uint32_t references[], size_t n, double values[],
                      size_t n_values);
fmi_status set_values(fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                      const double values[], size_t n_values);
/* For variables of other types, which do not exist. */
fmi_status no_such_type(const fmi_instance *i, const char *function, size_t n);

/* Changes of the unknowns along the seed of the knowns; adjoint: the gradient to the knowns by the seed of the unknowns. */
fmi_status differentiate(fmi_instance *i, const char *function, int is_adjoint, const uint32_t unknowns[],
                         size_t n_unknowns, const uint32_t knowns[], size_t n_knowns, const double seed[],
                         size_t n_seed, double sensitivity[], size_t n_sensitivity);
fmi_status get_output_rates(fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                            const int32_t orders[], double values[], size_t n_values);
fmi_status set_input_rates(fmi_instance *i, const char *function, const uint32_t references[], size_t n,
                           const int32_t orders[], const double values[]);

/* Life cycle */
void begin_anew(fmi_instance *i);
fmi_status set_experiment(fmi_instance *i, const char *function, fmi_call call, int tolerance_defined,
                          double tolerance, double start_time, int stop_time_defined, double stop_time);
/* `check` may be NULL. */
fmi_status change_mode(fmi_instance *i, const char *function, fmi_call call, fmi_mode next,
                       outcome (*check)(component *c));
fmi_status do_step(fmi_instance *i, const char *function, double time, double step, const step_observer *observer);

/* Saved states and their serialized form: versioned, without pointers, the same on every machine. */
fmi_status save_state(fmi_instance *i, const char *function, void **saved);
fmi_status restore_state(fmi_instance *i, const char *function, const void *saved);
fmi_status free_state(fmi_instance *i, const char *function, void **saved);
fmi_status serialized_size(const fmi_instance *i, const char *function, const void *saved, size_t *size);
fmi_status serialize(const fmi_instance *i, const char *function, const void *saved, unsigned char bytes[],
                     size_t size);
fmi_status deserialize(const fmi_instance *i, const char *function, const unsigned char bytes[], size_t size,
                       void **saved);
INTERNAL_END

#endif
