/* Limits of the pose, for units and for members of lanes; condition number of the leg Jacobian. */
#ifndef CONDITIONING_H
#define CONDITIONING_H

#include "internal.h"
#include "plant_table.h"

INTERNAL_BEGIN
/* Replaces b (N_LEGS, m) by the solution x of a x = b, by Gaussian elimination with partial pivoting, which overwrites a.
   Returns det a; or 0, without a solution, if a pivot is not larger than `smallest`. */
double solve(double a[N_LEGS][N_LEGS], double smallest, int m, double b[]);
/* Condition number in Frobenius norms, which is one to six times the spectral one. */
double exact_condition_number(const double jacobian[N_LEGS][N_LEGS]);
/* The same and det J; an upper bound instead if that is below the limit, which costs less:
   kappa <= 2 / |det J| (|J|_F / sqrt n)^n (Guggenheimer, Edelman & Johnson 1995). */
double condition_number(const double jacobian[N_LEGS][N_LEGS], double *determinant);
/* FAILURE_GOES_ON, or which limit the pose of n states x with these legs violates; of a collapsed leg, the shortest one's
   number is added. `side` is the sign of det J of the motion so far, 0 if it is not known; it becomes that of a pose within
   the limits. */
int pose_failure(const double x[], int n, const double length[N_LEGS], const double jacobian[N_LEGS][N_LEGS], double rho,
                 double *side);
INTERNAL_END

#endif
