/* What a machine follows, computed at each row: the reference, and forces along it. */
#ifndef PLANNING_H
#define PLANNING_H

#include <stdint.h>

#define N_REFERENCE 30

typedef struct {
    int64_t kind;               /* of motion, see harness/export/plan_c.py; 0 is one that the caller gives */
    const double *coefficients; /* the values of its keys */
    int64_t n_pieces;           /* of a table: when each begins [s], and its polynomials (6, 6), highest power first */
    const double *begins, *pieces;
    double end;             /* after it forces look no further [s] */
    const double *platform; /* (N_PARAMETERS), the nominal model */
    int64_t feedforward;    /* 0 none, 1 gravity, 2 computed torque */
    double ahead;           /* [s] */
    const double *given;    /* (18) pose, rates and accelerations that the caller writes, and their time [s] */
    const double *given_at;
    double *reference, *forces, *jacobians, *inverses; /* for the rows of a call */
} planned;

/* All signals of the reference, then accelerations (30). */
void plan_reference(const planned *p, double time, double reference[]);
/* The leg Jacobian there and its inverse (36), by rows. */
void plan_maps_at(const planned *p, double time, double jacobian[], double inverse[]);
/* The feedforward (6) [N] of a sample. */
void plan_forces(const planned *p, double time, double force[]);

#endif
