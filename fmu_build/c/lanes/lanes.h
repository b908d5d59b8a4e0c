/* Many platforms at once, eight in a vector: what the library offers. No state, no allocation; calls for different
   members may run side by side. */
#ifndef LANES_H
#define LANES_H

#include <stdint.h>

#if defined(_WIN32)
#define OFFERED __declspec(dllexport)
#else
#define OFFERED __attribute__((visibility("default")))
#endif

/* M = 8 `blocks` members. An array (size, M) has the members side by side, and row after row in a distance of `stride`
   numbers: best no power of two, at which rows would drive each other out of the processor's cache. */
typedef struct {
    int64_t blocks;
    int64_t stride;
    const double *parameters; /* (blocks, N_PARAMETERS, 8), on a boundary of 64 bytes */
    double *states;           /* (N_STATES, M) */
    const double *inputs;     /* (N_INPUTS, M) */
    const int64_t *running;   /* (M), 0 or -1: a member with 0 stays as it is */
    double *side;             /* (M), sign of det J: the side of the singular poses; 0 where it is not known yet */
    int64_t *failure;         /* (M), a FAILURE of lanes_table.h */
    double *reached;          /* (N_STATES, M), where it failed */
    int64_t *failed_at;       /* (M), in which substep, from 1 */
} batch;

/* `substeps` steps of classical RK4, each of `size` [s], under constant inputs. Members that fail stay as they were, with
   the reason; the number of them. Poses are checked at the end of each substep unless `unchecked`. Writes the signals at the
   end (N_SIGNALS, M), unless NULL: while all is at hand they cost little. */
OFFERED int64_t lanes_step(const batch *of, double size, int64_t substeps, int64_t unchecked, double *signals);
/* Whether a motion may begin in the present poses: as `lanes_step`, of no duration. */
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
