/* Condition number of the leg Jacobian. */
#ifndef CONDITIONING_H
#define CONDITIONING_H

#include "internal.h"
#include "plant_table.h"

INTERNAL_BEGIN
/* Condition number in Frobenius norms, which is one to six times the spectral one. */
double exact_condition_number(const double jacobian[N_LEGS][N_LEGS]);
/* The same and det J; an upper bound instead if that is below the limit, which costs less:
   kappa <= 2 / |det J| (|J|_F / sqrt n)^n (Guggenheimer, Edelman & Johnson 1995). */
double condition_number(const double jacobian[N_LEGS][N_LEGS], double *determinant);
INTERNAL_END

#endif
