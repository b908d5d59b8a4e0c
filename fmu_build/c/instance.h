/* An instance of the unit, whatever the FMI version: a component, its mode, its log, and how calls reach it.

   Functions that take `function` are the work of the FMI function of that name: they check whether it is allowed and
   its arguments, and log what is wrong. A call that does not return STATUS_OK has changed nothing. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

#include "component.h"
#include "modes.h"

/* The numbers are those of fmi2Status and fmi3Status. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL } status;

typedef struct instance instance;

/* What differs between the FMI versions. */
typedef struct {
    /* slots of a value reference; 0 if there is no such variable */
    int (*resolve)(uint32_t reference, int *first, int *size);
    void (*deliver)(const instance *i, status status, const char *category, const char *message);
} version;

typedef void (*any_function)(void);

struct instance {
    component component;
    kind kind;
    mode mode;
    const version *version;
    /* the importer's */
    void *environment;
    any_function logger;
    any_function intermediate_update; /* FMI 3.0 */
    int may_return_early;             /* FMI 3.0 */
    int logs;
    unsigned categories; /* a bit for each */
    /* of the last step, for FMI 2.0 */
    status step_status;
    double last_successful_time;
    const char *name; /* lies behind the instance, in the same allocation */
};

INTERNAL_BEGIN
/* A copy of `given`, which has the importer's part, initialised; NULL if token or name are wrong. */
instance *new_instance(const instance *given, const char *name, const char *token);

status report(const instance *i, status status, const char *format, ...);
int allows(const instance *i, call call);
/* 1 if the instance is there and the call allowed now; logs if not. */
int is_allowed(const instance *i, const char *function, call call);
/* Logs what the component found. */
status conclude(const instance *i, const char *function, outcome outcome);
/* 1 unless `n` elements are wanted from nowhere. */
int has_array(const instance *i, const char *function, const void *array, size_t n, const char *name);
int has_length(const instance *i, const char *function, size_t given, size_t expected, const char *name);

status set_logging(instance *i, const char *function, int on, size_t n, const char *const categories[]);

/* The length of the value array is unknown to FMI 2.0: one value for every reference. */
#define ONE_EACH SIZE_MAX

status get_values(instance *i, const char *function, const uint32_t references[], size_t n, double values[],
                  size_t n_values);
status set_values(instance *i, const char *function, const uint32_t references[], size_t n, const double values[],
                  size_t n_values);
/* No variables of another type exist. */
status no_such_type(const instance *i, const char *function, size_t n);

status get_directional_derivative(instance *i, const char *function, const uint32_t unknowns[], size_t n_unknowns,
                                  const uint32_t knowns[], size_t n_knowns, const double seed[], size_t n_seed,
                                  double sensitivity[], size_t n_sensitivity);
status get_adjoint_derivative(instance *i, const char *function, const uint32_t unknowns[], size_t n_unknowns,
                              const uint32_t knowns[], size_t n_knowns, const double seed[], size_t n_seed,
                              double sensitivity[], size_t n_sensitivity);
status get_output_rates(instance *i, const char *function, const uint32_t references[], size_t n,
                        const int32_t orders[], double values[], size_t n_values);
status set_input_rates(instance *i, const char *function, const uint32_t references[], size_t n,
                       const int32_t orders[], const double values[]);

/* Life */
status set_experiment(instance *i, const char *function, call call, int tolerance_defined, double tolerance,
                      double start_time, int stop_time_defined, double stop_time);
status exit_initialization(instance *i, const char *function);
status change_mode(instance *i, const char *function, call call, mode next);
status enter_continuous(instance *i, const char *function);
status reset(instance *i, const char *function);
status do_step(instance *i, const char *function, double time, double step, const observer *observer);

/* Model exchange */
status set_time(instance *i, const char *function, double time);
status set_continuous_states(instance *i, const char *function, const double x[], size_t n);
status get_continuous_states(instance *i, const char *function, double x[], size_t n);
status get_derivatives(instance *i, const char *function, double xdot[], size_t n);
status get_nominals(instance *i, const char *function, double nominals[], size_t n);
status get_event_indicators(instance *i, const char *function, const double indicators[], size_t n);
status completed_step(instance *i, const char *function);
INTERNAL_END

#endif
