/* The ONE table of allowed calls by kind and mode of the instance, for FMI 2.0 and 3.0; and of the kinds for which a
   call may return Discard in FMI 2.0, which lists the functions (2.1.3). In FMI 3.0 every function may. */
#ifndef MODES_H
#define MODES_H

#include "model.h"

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

#define BOTH (MODEL_EXCHANGE | CO_SIMULATION)

/* call, allowed for these kinds, may return Discard for these kinds, allowed in these modes */
#define CALLS(ROW)                                                                                                     \
    ROW(CALL_SET_LOGGING,           BOTH,           NEVER,          BETWEEN_CALLS)                                     \
    ROW(CALL_RESET,                 BOTH,           NEVER,          BETWEEN_CALLS)                                     \
    ROW(CALL_FMU_STATE,             BOTH,           NEVER,          BETWEEN_CALLS)                                     \
    ROW(CALL_SET_EXPERIMENT,        BOTH,           NEVER,          INSTANTIATED)                                      \
    ROW(CALL_ENTER_INITIALIZATION,  BOTH,           NEVER,          INSTANTIATED)                                      \
    ROW(CALL_EXIT_INITIALIZATION,   BOTH,           NEVER,          INITIALIZATION)                                    \
    ROW(CALL_TERMINATE,             BOTH,           NEVER,          RUNNING)                                           \
    ROW(CALL_GET,                   BOTH,           MODEL_EXCHANGE, ANY_MODE)                                          \
    ROW(CALL_SET,                   BOTH,           BOTH,           BEFORE_START | RUNNING | INTERMEDIATE)             \
    ROW(CALL_SET_START,             BOTH,           BOTH,           BEFORE_START)                                      \
    ROW(CALL_SET_TUNABLE,           BOTH,           BOTH,           BEFORE_START | EVENT | STEP)                       \
    ROW(CALL_SENSITIVITY,           BOTH,           NEVER,          IF_CONTINUOUS(INITIALIZATION | RUNNING | TERMINATED))\
    ROW(CALL_SET_INPUT_RATES,       CO_SIMULATION,  NEVER,          BEFORE_START | STEP)                               \
    ROW(CALL_GET_OUTPUT_RATES,      CO_SIMULATION,  NEVER,          IF_CONTINUOUS(STEP | INTERMEDIATE | TERMINATED))   \
    ROW(CALL_DO_STEP,               CO_SIMULATION,  CO_SIMULATION,  STEP)                                              \
    ROW(CALL_STEP_STATUS,           CO_SIMULATION,  CO_SIMULATION,  STEP | TERMINATED)                                 \
    ROW(CALL_ENTER_EVENT,           MODEL_EXCHANGE, NEVER,          CONTINUOUS)                                        \
    ROW(CALL_UPDATE_DISCRETE,       MODEL_EXCHANGE, NEVER,          EVENT)                                             \
    ROW(CALL_ENTER_CONTINUOUS,      MODEL_EXCHANGE, NEVER,          EVENT)                                             \
    ROW(CALL_COMPLETED_STEP,        MODEL_EXCHANGE, NEVER,          CONTINUOUS)                                        \
    ROW(CALL_SET_TIME,              MODEL_EXCHANGE, NEVER,          EVENT | CONTINUOUS)                                \
    ROW(CALL_SET_CONTINUOUS_STATES, MODEL_EXCHANGE, MODEL_EXCHANGE, CONTINUOUS)                                        \
    ROW(CALL_GET_CONTINUOUS_STATES, MODEL_EXCHANGE, MODEL_EXCHANGE, BEFORE_START | EVENT | CONTINUOUS | TERMINATED)    \
    ROW(CALL_GET_NUMBERS,           MODEL_EXCHANGE, NEVER,          BEFORE_START | EVENT | CONTINUOUS)                 \
    ROW(CALL_EVALUATE_DISCRETE,     MODEL_EXCHANGE, NEVER,          INITIALIZATION | EVENT)                            \
    /* there are no clocks, no structural parameters, no asynchronous steps */                                         \
    ROW(CALL_NOT_OFFERED,           BOTH,           NEVER,          NEVER)

#define AS_NAME(name, kinds, discards, modes) name,
typedef enum { CALLS(AS_NAME) NUMBER_OF_CALLS } fmi_call;
#undef AS_NAME

#endif
