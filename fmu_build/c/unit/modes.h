/* The ONE table of which call is allowed to which kind of instance in which mode, for FMI 2.0 and 3.0. */
#ifndef MODES_H
#define MODES_H

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

#define BOTH (MODEL_EXCHANGE | CO_SIMULATION)

/* clang-format off */
#define CALLS(ROW)                                                                                       \
    ROW(CALL_SET_LOGGING,           BOTH,           BETWEEN_CALLS)                                       \
    ROW(CALL_RESET,                 BOTH,           BETWEEN_CALLS)                                       \
    ROW(CALL_FMU_STATE,             BOTH,           BETWEEN_CALLS)                                       \
    ROW(CALL_SET_EXPERIMENT,        BOTH,           INSTANTIATED)                                        \
    ROW(CALL_ENTER_INITIALIZATION,  BOTH,           INSTANTIATED)                                        \
    ROW(CALL_EXIT_INITIALIZATION,   BOTH,           INITIALIZATION)                                      \
    ROW(CALL_TERMINATE,             BOTH,           RUNNING)                                             \
    ROW(CALL_GET,                   BOTH,           ANY_MODE)                                            \
    ROW(CALL_SET_INPUT,             BOTH,           BEFORE_START | RUNNING | INTERMEDIATE)               \
    ROW(CALL_SET_START,             BOTH,           BEFORE_START)                                        \
    ROW(CALL_SET_TUNABLE,           BOTH,           BEFORE_START | EVENT | STEP)                         \
    ROW(CALL_SENSITIVITY,           BOTH,           INITIALIZATION | RUNNING | TERMINATED)               \
    ROW(CALL_SET_INPUT_RATES,       CO_SIMULATION,  BEFORE_START | STEP)                                 \
    ROW(CALL_GET_OUTPUT_RATES,      CO_SIMULATION,  STEP | INTERMEDIATE | TERMINATED)                    \
    ROW(CALL_DO_STEP,               CO_SIMULATION,  STEP)                                                \
    ROW(CALL_STEP_STATUS,           CO_SIMULATION,  STEP | TERMINATED)                                   \
    ROW(CALL_ENTER_EVENT,           MODEL_EXCHANGE, CONTINUOUS)                                          \
    ROW(CALL_UPDATE_DISCRETE,       MODEL_EXCHANGE, EVENT)                                               \
    ROW(CALL_ENTER_CONTINUOUS,      MODEL_EXCHANGE, EVENT)                                               \
    ROW(CALL_COMPLETED_STEP,        MODEL_EXCHANGE, CONTINUOUS)                                          \
    ROW(CALL_SET_TIME,              MODEL_EXCHANGE, EVENT | CONTINUOUS)                                  \
    ROW(CALL_SET_CONTINUOUS_STATES, MODEL_EXCHANGE, CONTINUOUS)                                          \
    ROW(CALL_GET_CONTINUOUS_STATES, MODEL_EXCHANGE, BEFORE_START | EVENT | CONTINUOUS | TERMINATED)      \
    ROW(CALL_GET_NUMBERS,           MODEL_EXCHANGE, BEFORE_START | EVENT | CONTINUOUS)                   \
    ROW(CALL_EVALUATE_DISCRETE,     MODEL_EXCHANGE, INITIALIZATION | EVENT)                              \
    /* there are no clocks, no structural parameters, no scheduled execution, no asynchronous steps */   \
    ROW(CALL_NOT_OFFERED,           BOTH,           NEVER)
/* clang-format on */

#define AS_NAME(name, kinds, modes) name,
typedef enum { CALLS(AS_NAME) NUMBER_OF_CALLS } fmi_call;
#undef AS_NAME

#endif
