/* One step of ETDRK4, which the steps under error control (exponential.c) and fixed steps (fixed_bristles.c) share. */
#ifndef EXPONENTIAL_H
#define EXPONENTIAL_H

#include "integrator.h"
#include "internal.h"

#if HAS_BRISTLES
/* Of a step h and the rates of the bristles. */
typedef struct {
    double decay[N_LEGS];  /* d */
    double whole[N_LEGS];  /* exp(-h d) */
    double half[N_LEGS];   /* exp(-h d/2) */
    double inner[N_LEGS];  /* (h/2) phi1(-h d/2) */
    double first[N_LEGS];  /* h (phi1 - 3 phi2 + 4 phi3) */
    double middle[N_LEGS]; /* h (2 phi2 - 4 phi3) */
    double last[N_LEGS];   /* h (4 phi3 - phi2) */
} coefficients;

INTERNAL_BEGIN
/* phi1 to phi4 of z <= 0, and exp(z): phi0 = exp(z), phi_(k+1) = (phi_k - 1/k!)/z */
double phi_functions(double z, double phi[4]);
void find_coefficients(const double decay[N_LEGS], double h, coefficients *c);
/* From (t, x) with the derivatives k1 there to `end` after h. */
void exponential_step(const ode *problem, const coefficients *c, double t, double h, const double x[N_STATES],
                      const double k1[N_STATES], double end[N_STATES]);
INTERNAL_END
#endif

#endif
