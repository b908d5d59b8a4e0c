/* Interface of the library for many platforms at once, eight per vector, and of what c/loop asks for. No state, no
   allocation; calls for different members can run in parallel. */
#ifndef LANES_H
#define LANES_H

#include "elementary.h"
#include "lanes_table.h"

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
    double *failed_after;     /* (M), time of the failure since the begin of the step [s] */
    double *error;            /* (M), largest estimate of the error of a step so far */
    double *proposed;         /* (M), size of the next internal step of error control [s]; 0 before the first */
    double *internal_steps;   /* (M), internal steps so far, with those that were too large */
} batch;

/* A step under constant inputs; its duration may be 0. Returns the number of members that fail; their states do not
   change, and `failure` has the reason. Poses are checked at the end of each internal step. Writes the signals at the end
   (N_SIGNALS, M) unless NULL; computing them here is cheap.

   With `substeps` so many of classical RK4, each of `size` [s]. The error is max |x - x5| / (1 + |x|) with x5 of order 5
   by Cash and Karp (ACM Trans. Math. Softw. 16, 1990, 201-222) from the begin of each substep, the sum over them.
   Without, a step of `size` with error-controlled internal steps, each member's own, that end at its end, see steps.h.
   The error of an internal step is at most `tolerance`; that of a step the sum of its internal ones. A member that needs
   more than MOST_LANE_STEPS fails. */
OFFERED int64_t lanes_step(const batch *members, double size, int64_t substeps, double tolerance, double *signals);
/* Checks the current poses, which a step of duration 0 does not do; returns what `lanes_step` does. */
OFFERED int64_t lanes_check(const batch *members);
/* (N_RESULTS, M) */
OFFERED void lanes_results(const batch *members, double *results);
/* sin, cos and tanh of (8 `blocks`) numbers, (3, 8 `blocks`) */
OFFERED void lanes_elementary(int64_t blocks, const double *x, double *y);

/* ---- the members of one vector during a step -------------------------------------------------------------------- */

/* How far a state is from the pose limits: L_i^2, det K and rho^2, see margins_function of model/traced.py. */
typedef struct {
    lanes square[N_LEGS], determinant, size;
} pose_margins;

/* What depends on a state alone: signals, margins, and what the derivatives of the ideal plant need of it besides the
   inputs, or the rates of bristles. */
typedef struct {
    lanes signals[N_SIGNALS];
    pose_margins from_limits;
#if HAS_BRISTLES
    lanes decay[N_LEGS];
#elif !HAS_SPRINGS
    lanes shared[N_SHARED];
#endif
} evaluation;

typedef struct {
    const batch *members;
    int64_t first;   /* of the members */
    const lanes *p;  /* (N_PARAMETERS) */
    lanes x[N_STATES], u[N_INPUTS];
    lanes side;      /* sign of det J; 0 if not yet known */
    mask running;
    evaluation at_x; /* of x */
} group;

/* Number of parameters of the geometry, which come first. */
#define N_GEOMETRY P_PLATFORM_MASS

/* Reads a block and evaluates its states; `parameters` is how many are needed: N_GEOMETRY, or N_PARAMETERS and the inputs. */
void read_group(group *g, const batch *members, int64_t block, int parameters);
/* The two kinds of steps of `lanes_step`, which return how many members fail. A member that fails stops, and its state
   stays; `at_x.signals` are those at the end. */
int64_t step_fixed(group *g, double size, int64_t substeps);
int64_t step_controlled(group *g, double duration, double tolerance);
void find_results(const group *g, lanes results[]);

#endif
