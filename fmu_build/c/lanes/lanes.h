/* Interface of the library for many platforms at once, eight per vector. No state, no allocation; calls for different
   members can run in parallel. */
#ifndef LANES_H
#define LANES_H

#include <stdint.h>

#if defined(_WIN32)
#define OFFERED __declspec(dllexport)
#else
#define OFFERED __attribute__((visibility("default")))
#endif

/* M = 8 `blocks` members. In an array (size, M) the members are contiguous, and rows are `stride` numbers apart. A power
   of two is unfavourable, since rows would evict each other from the cache. */
typedef struct {
    int64_t blocks;
    int64_t stride;
    const double *parameters; /* (blocks, N_PARAMETERS, 8), aligned to 64 bytes */
    double *states;           /* (N_STATES, M) */
    const double *inputs;     /* (N_INPUTS, M) */
    const int64_t *running;   /* (M), 0 or -1: a member with 0 is not changed */
    double *side;             /* (M), sign of det J; 0 if not yet known */
    int64_t *failure;         /* (M), a FAILURE of lanes_table.h */
    double *reached;          /* (N_STATES, M), state at the failure */
    int64_t *failed_at;       /* (M), substep of the failure, from 1 */
    double *difference;       /* (M), largest difference of the stages of a repeated step so far */
    double *allowed;          /* (M), steps that may be repeated before a new record */
    double *error;            /* (M), largest estimate of the error of a step so far */
} batch;

/* `substeps` steps of classical RK4, each of `size` [s], under constant inputs. Returns the number of members that
   fail; their states do not change, and `failure` has the reason. Poses are checked at the end of each substep, and
   errors estimated; neither if `plain`. Writes the signals at the end (N_SIGNALS, M) unless NULL; computing them here is
   cheap.

   The error is max |x - x'| / (1 + |x|), x' with twice as many substeps, which only some steps are repeated with. The
   stages k1 to k4 of all substeps tell which: the differences size |k2 - k3| and size |k1 - k2 - k3 + k4|, relative to
   1 + |x|, are of lower order than the error; in all trials they were at least four times as large. A step is repeated where
   ERROR_OF_DIFFERENCE of them is more than the member's largest error so far, if they exceed their own largest by the
   factor RECORD; and below that as long as the member has repeated no more than REPEATED_FIRST steps and REPEATED_SHARE
   of all: the fewer are allowed, the nearer to the largest. Each member decides by its own numbers alone. */
OFFERED int64_t lanes_step(const batch *of, double size, int64_t substeps, int64_t plain, double *signals);
/* Checks the current poses: like `lanes_step` of zero duration. */
OFFERED int64_t lanes_check(const batch *of);
/* (N_SIGNALS, M) */
OFFERED void lanes_signals(const batch *of, double *signals);
/* (N_RESULTS, M) */
OFFERED void lanes_results(const batch *of, double *results);
/* dx/dt (N_STATES, M) */
OFFERED void lanes_derivatives(const batch *of, double *derivatives);
/* sin, cos and tanh of (8 `blocks`) numbers, (3, 8 `blocks`) */
OFFERED void lanes_elementary(int64_t blocks, const double *x, double *y);

#endif
