/* An instance of the unit, independent of the FMI version: a component with its mode and its log.

   Functions that return a status implement functions of the standard: they check whether the call is allowed, check its
   arguments, and log errors. A call that does not return STATUS_OK changes nothing. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

#include "component.h"
#include "model.h"
#include "modes.h"

/* The same numbers as fmi2Status and fmi3Status. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL } fmi_status;

typedef struct fmi_instance fmi_instance;

/* The differences between the FMI versions. */
typedef struct {
    const char *token; /* the same as in modelDescription.xml; empty if the library is not for this version */
    /* slots of a value reference; 0 if there is no such variable */
    int (*resolve)(uint32_t reference, int *first, int *size);
    int discards_as_listed; /* Discard only where modes.h allows it */
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
    const char *function; /* of the standard, that has been called: messages begin with its name */
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
fmi_instance *new_instance(fmi_instance *request, const char *name, const char *token);

fmi_status report(const fmi_instance *i, fmi_status status, const char *format, ...);
const char *name_of_kind(fmi_kind kind);
int allows(const fmi_instance *i, fmi_call call);
/* 1 if the instance exists and the call is allowed in its mode; logs an error if not. */
int is_allowed(fmi_instance *i, fmi_call call);
/* The status for a component's outcome; logs its message. */
fmi_status conclude(fmi_instance *i, fmi_call call, outcome result);
/* 0 if the array is NULL but has `n` > 0 elements; logs an error. */
int has_array(fmi_instance *i, const void *array, size_t n, const char *name);
int has_length(fmi_instance *i, size_t found, size_t expected, const char *name);
/* For functions of the state vector: whether the call is allowed, with N_STATES elements. */
int has_states(fmi_instance *i, fmi_call call, const void *x, size_t n);

fmi_status set_logging(fmi_instance *i, int on, size_t n, const char *const categories[]);

/* FMI 2.0 does not pass the length of the value array: one value per reference. */
#define ONE_EACH SIZE_MAX

fmi_status get_values(fmi_instance *i, const uint32_t references[], size_t n, double values[], size_t n_values);
fmi_status set_values(fmi_instance *i, const uint32_t references[], size_t n, const double values[], size_t n_values);
/* For variables of other types, which do not exist. */
fmi_status no_such_type(fmi_instance *i, size_t n);

/* Changes of the unknowns along the seed of the knowns; adjoint: the gradient to the knowns by the seed of the unknowns. */
fmi_status differentiate(fmi_instance *i, int is_adjoint, const uint32_t unknowns[], size_t n_unknowns,
                         const uint32_t knowns[], size_t n_knowns, const double seed[], size_t n_seed,
                         double sensitivity[], size_t n_sensitivity);
fmi_status get_output_rates(fmi_instance *i, const uint32_t references[], size_t n, const int32_t orders[],
                            double values[], size_t n_values);
fmi_status set_input_rates(fmi_instance *i, const uint32_t references[], size_t n, const int32_t orders[],
                           const double values[]);

fmi_status begin_anew(fmi_instance *i);
fmi_status set_experiment(fmi_instance *i, fmi_call call, int tolerance_defined, double tolerance, double start_time,
                          int stop_time_defined, double stop_time);
/* `check` may be NULL. */
fmi_status change_mode(fmi_instance *i, fmi_call call, fmi_mode next, outcome (*check)(component *c));
fmi_status do_step(fmi_instance *i, double time, double step, const step_observer *observer);

/* Saved states and their serialized form: versioned, without pointers, the same for all targets. */
fmi_status save_state(fmi_instance *i, void **saved);
fmi_status restore_state(fmi_instance *i, const void *saved);
fmi_status free_state(fmi_instance *i, void **saved);
fmi_status serialized_size(fmi_instance *i, const void *saved, size_t *size);
fmi_status serialize(fmi_instance *i, const void *saved, unsigned char bytes[], size_t size);
fmi_status deserialize(fmi_instance *i, const unsigned char bytes[], size_t size, void **saved);
INTERNAL_END

#endif
