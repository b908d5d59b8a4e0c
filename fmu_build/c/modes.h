/* The ONE table of which call is allowed in which mode, for FMI 2.0 and 3.0. */
#ifndef MODES_H
#define MODES_H

typedef enum { MODEL_EXCHANGE = 1, CO_SIMULATION = 2 } kind;

typedef enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    EVENT = 4,       /* model exchange */
    CONTINUOUS = 8,  /* model exchange: "continuous-time mode" */
    STEP = 16,       /* co-simulation: "step mode", in FMI 2.0 "slave initialized" */
    INTERMEDIATE = 32, /* co-simulation, FMI 3.0: in the callback of a step */
    TERMINATED = 64
} mode;

#define BEFORE_START (INSTANTIATED | INITIALIZATION)
#define RUNNING (EVENT | CONTINUOUS | STEP)
#define BETWEEN_CALLS (BEFORE_START | RUNNING | TERMINATED)
#define ANY_MODE (BETWEEN_CALLS | INTERMEDIATE)
#define NEVER 0

/* clang-format off */
#define CALLS(ROW)                                                                      \
    ROW(CALL_SET_LOGGING,            BETWEEN_CALLS)                                     \
    ROW(CALL_RESET,                  BETWEEN_CALLS)                                     \
    ROW(CALL_FMU_STATE,              BETWEEN_CALLS)                                     \
    ROW(CALL_SET_EXPERIMENT,         INSTANTIATED)                                      \
    ROW(CALL_ENTER_INITIALIZATION,   INSTANTIATED)                                      \
    ROW(CALL_EXIT_INITIALIZATION,    INITIALIZATION)                                    \
    ROW(CALL_TERMINATE,              RUNNING)                                           \
    ROW(CALL_GET,                    ANY_MODE)                                          \
    ROW(CALL_SET_INPUT,              BEFORE_START | RUNNING | INTERMEDIATE)             \
    ROW(CALL_SET_START,              BEFORE_START)                                      \
    ROW(CALL_SET_TUNABLE,            BEFORE_START | EVENT | STEP)                       \
    ROW(CALL_SENSITIVITY,            INITIALIZATION | RUNNING | TERMINATED)             \
    /* co-simulation */                                                                 \
    ROW(CALL_SET_INPUT_RATES,        BEFORE_START | STEP)                               \
    ROW(CALL_GET_OUTPUT_RATES,       STEP | INTERMEDIATE | TERMINATED)                  \
    ROW(CALL_DO_STEP,                STEP)                                              \
    ROW(CALL_STEP_STATUS,            STEP | TERMINATED)                                 \
    /* model exchange */                                                                \
    ROW(CALL_ENTER_EVENT,            CONTINUOUS)                                        \
    ROW(CALL_UPDATE_DISCRETE,        EVENT)                                             \
    ROW(CALL_ENTER_CONTINUOUS,       EVENT)                                             \
    ROW(CALL_COMPLETED_STEP,         CONTINUOUS)                                        \
    ROW(CALL_SET_TIME,               EVENT | CONTINUOUS)                                \
    ROW(CALL_SET_CONTINUOUS_STATES,  CONTINUOUS)                                        \
    ROW(CALL_GET_CONTINUOUS_STATES,  BEFORE_START | EVENT | CONTINUOUS | TERMINATED)    \
    ROW(CALL_GET_NUMBERS,            BEFORE_START | EVENT | CONTINUOUS)                 \
    ROW(CALL_EVALUATE_DISCRETE,      INITIALIZATION | EVENT)                            \
    /* there are no clocks, no structural parameters, no scheduled execution, no asynchronous steps */ \
    ROW(CALL_NOT_OFFERED,            NEVER)
/* clang-format on */

#define AS_NAME(name, modes) name,
typedef enum { CALLS(AS_NAME) NUMBER_OF_CALLS } call;
#undef AS_NAME

#endif
