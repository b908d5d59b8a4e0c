/* The largest fixed step in which sticking or elastic legs are stable. */
#ifndef STABLE_STEP_H
#define STABLE_STEP_H

#include "internal.h"
#include "model.h"

INTERNAL_BEGIN
/* LARGEST_PRODUCT over the largest |eigenvalue| of the plant at rest in this pose, all legs sticking; infinite for the
   ideal plant, which has no such modes. */
double stable_step(const double x[N_STATES], const double u[N_INPUTS], const double p[N_PARAMETERS]);
INTERNAL_END

#endif
