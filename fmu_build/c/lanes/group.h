/* The members of one vector during a step: what lanes.c does with them, and c/loop asks for. */
#ifndef GROUP_H
#define GROUP_H

#include "elementary.h"
#include "lanes.h"
#include "lanes_table.h"

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
