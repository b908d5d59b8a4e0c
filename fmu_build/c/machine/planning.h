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
    double *given;          /* (18) pose, rates and accelerations that the caller writes, and their time [s] */
    double *given_at;
    /* where a hand wants the platform: pose and angles (6), followed by a filter with limits, whose coefficients are those
       of positions, then those of angles */
    double *target;
    const double *smoothing;
    double *smoothed; /* (18) values, rates and accelerations */
    int64_t *samples; /* (1) that the filter has done; -1: what is given is not filtered */
    double *reference, *forces, *jacobians, *inverses; /* for the rows of a call */
} planned;

/* All signals of the reference, then accelerations (30). */
void plan_reference(const planned *p, double time, double reference[]);
/* The leg Jacobian there and its inverse (36), by rows. */
void plan_maps_at(const planned *p, double time, double jacobian[], double inverse[]);
/* Takes the motion of a time over into the hand's filter, and gives it from then on. */
void plan_take(planned *p, double time);
/* What the hand's filter gives at a sample, once. */
void plan_by_hand(const planned *p, int64_t sample, double time);
/* The feedforward (6) [N] of a sample. */
void plan_forces(const planned *p, double time, double force[]);

#endif
