/* How near a leg Jacobian is to a singular one. */
#ifndef CONDITIONING_H
#define CONDITIONING_H

#include "internal.h"
#include "plant_table.h"

INTERNAL_BEGIN
/* In Frobenius norms: between the spectral condition number and six times it; and det J. Any upper bound below the limit
   may be given instead: kappa <= 2 / |det J| (|J|_F / sqrt n)^n (Guggenheimer, Edelman & Johnson 1995) costs less. */
double condition_number(const double jacobian[N_LEGS][N_LEGS], double *determinant);
INTERNAL_END

#endif
