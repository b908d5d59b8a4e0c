/* Steps of a plant whose bristles forget fast: a sliding bristle obeys dz/dt = v - d z with a rate d of up to 1e5/s, by
   which explicit steps of 1 ms diverge. ETDRK4 takes the part -d z exactly: S. M. Cox, P. C. Matthews, "Exponential Time
   Differencing for Stiff Systems", J. Comput. Phys. 176(2), 2002, eqs. (26)-(29), with the rates d as they are at the
   begin of a step. For all other states it is classical RK4. The order is 4 where friction is smooth, 2 over a step in
   which a leg reverses or breaks away, since the law has a kink there. */
#include "exponential.h"

#if HAS_BRISTLES
#include <float.h>
#include <math.h>
#include <string.h>

/* Below this |z| the functions phi are summed as series, above it taken from exp(z), with at most two digits lost. */
static const double SERIES_BELOW = 1;
enum { TERMS = 18 };

double phi_functions(double z, double phi[4])
{
    if (fabs(z) < SERIES_BELOW) {
        double fourth = 0;
        for (int j = TERMS; j > 4; j--)
            fourth = z / j * (1 + fourth);
        phi[3] = (1 + fourth) / 24;
        phi[2] = 1.0 / 6 + z * phi[3];
        phi[1] = 0.5 + z * phi[2];
        phi[0] = 1 + z * phi[1];
        return 1 + z * phi[0];
    }
    double e = exp(z);
    phi[0] = (e - 1) / z;
    phi[1] = (phi[0] - 1) / z;
    phi[2] = (phi[1] - 0.5) / z;
    phi[3] = (phi[2] - 1.0 / 6) / z;
    return e;
}

void find_coefficients(const double decay[N_LEGS], double h, coefficients *c)
{
    for (int i = 0; i < N_LEGS; i++) {
        double phi[4], half[4];
        c->decay[i] = decay[i];
        if (decay[i] == 0) { /* a leg that stands: RK4 */
            c->whole[i] = c->half[i] = 1;
            c->inner[i] = h / 2;
            c->first[i] = c->last[i] = h / 6;
            c->middle[i] = h / 3;
            continue;
        }
        c->whole[i] = phi_functions(-h * decay[i], phi);
        c->half[i] = phi_functions(-h * decay[i] / 2, half);
        c->inner[i] = h / 2 * half[0];
        c->first[i] = h * (phi[0] - 3 * phi[1] + 4 * phi[2]);
        c->middle[i] = h * (2 * phi[1] - 4 * phi[2]);
        c->last[i] = h * (4 * phi[2] - phi[1]);
    }
}

/* found = base + weight slope, with these bristles */
static void set_stage(double found[N_STATES], const double base[N_STATES], double weight, const double slope[N_STATES],
                      const double bristle[N_LEGS])
{
    for (int i = 0; i < N_STATES; i++)
        found[i] = base[i] + weight * slope[i];
    memcpy(found + X_LEG_BRISTLE, bristle, sizeof(double) * N_LEGS);
}

void exponential_step(const ode *problem, const coefficients *c, double t, double h, const double x[N_STATES],
                      const double k1[N_STATES], double end[N_STATES])
{
    double k2[N_STATES], k3[N_STATES], k4[N_STATES], sum[N_STATES], stage[N_STATES];
    double n1[N_LEGS], n2[N_LEGS], n3[N_LEGS], za[N_LEGS], zb[N_LEGS], zc[N_LEGS];
    const double *z = x + X_LEG_BRISTLE;
    for (int i = 0; i < N_LEGS; i++) {
        n1[i] = k1[X_LEG_BRISTLE + i] + c->decay[i] * z[i];
        za[i] = c->half[i] * z[i] + c->inner[i] * n1[i];
    }
    set_stage(stage, x, h / 2, k1, za);
    problem->derivatives(problem->owner, t + h / 2, stage, k2);
    for (int i = 0; i < N_LEGS; i++) {
        n2[i] = k2[X_LEG_BRISTLE + i] + c->decay[i] * za[i];
        zb[i] = c->half[i] * z[i] + c->inner[i] * n2[i];
    }
    set_stage(stage, x, h / 2, k2, zb);
    problem->derivatives(problem->owner, t + h / 2, stage, k3);
    for (int i = 0; i < N_LEGS; i++) {
        n3[i] = k3[X_LEG_BRISTLE + i] + c->decay[i] * zb[i];
        zc[i] = c->half[i] * za[i] + c->inner[i] * (2 * n3[i] - n1[i]);
    }
    set_stage(stage, x, h, k3, zc);
    problem->derivatives(problem->owner, t + h, stage, k4);
    for (int i = 0; i < N_LEGS; i++) {
        double n4 = k4[X_LEG_BRISTLE + i] + c->decay[i] * zc[i];
        zc[i] = c->whole[i] * z[i] + c->first[i] * n1[i] + c->middle[i] * (n2[i] + n3[i]) + c->last[i] * n4;
    }
    for (int i = 0; i < N_STATES; i++)
        sum[i] = k1[i] + 2 * (k2[i] + k3[i]) + k4[i];
    set_stage(end, x, h / 6, sum, zc);
}

/* The largest |a - b| in units of the tolerance at x and a, relative, and absolute in SI units times the nominal of a
   state over that of the pose. */
static double distance(const double a[N_STATES], const double b[N_STATES], const double x[N_STATES], double tolerance)
{
    double largest = 0;
    for (int i = 0; i < N_STATES; i++) {
        double size = NOMINAL_STATES[i] / NOMINAL_STATES[0];
        double r = fabs(a[i] - b[i]) / (tolerance * (size + fmax(fabs(x[i]), fabs(a[i]))));
        if (!(r <= largest))
            largest = r; /* also NaN */
        if (isnan(largest))
            break;
    }
    return largest;
}

/* By which the next step is longer, from 0.2 to 4; 0.1 if the error is not finite. */
static double factor_of(double error)
{
    if (!isfinite(error))
        return 0.1;
    return error > 0 ? fmin(4, fmax(0.2, 0.9 * pow(error, -0.2))) : 4;
}

integration integrate_controlled(const ode *problem, integration_point *at, double end, double tolerance)
{
    double h = at->step > 0 ? at->step : end - at->t;
    for (long steps = 0; at->t < end; steps++) {
        if (steps == MOST_INTERNAL_STEPS)
            return TOO_MANY_STEPS;
        int last = at->t + h >= end;
        double size = last ? end - at->t : h, t = last ? end : at->t + size;
        if (!(t > at->t) || (!last && h < 16 * DBL_EPSILON * fabs(end))) {
            at->step = size;
            return STEP_TOO_SMALL;
        }
        double decay[N_LEGS], coarse[N_STATES], middle[N_STATES], fine[N_STATES], rate[N_STATES];
        coefficients whole, half;
        problem->decays(problem->owner, at->x, decay);
        find_coefficients(decay, size, &whole);
        find_coefficients(decay, size / 2, &half);
        exponential_step(problem, &whole, at->t, size, at->x, at->xdot, coarse);
        exponential_step(problem, &half, at->t, size / 2, at->x, at->xdot, middle);
        /* the same rate in both halves: any is right, the nearest is the most exact */
        problem->derivatives(problem->owner, at->t + size / 2, middle, rate);
        exponential_step(problem, &half, at->t + size / 2, size / 2, middle, rate, fine);
        double error = distance(fine, coarse, at->x, tolerance) / 15, factor = factor_of(error);
        if (!(error <= 1)) {
            at->step = h = size * factor;
            if (h < DBL_MIN)
                return STEP_TOO_SMALL;
            continue;
        }
        /* a step shortened to end on time is no estimate for the next one */
        at->step = h = last && size < h ? fmax(h, size * factor) : size * factor;
        problem->derivatives(problem->owner, t, fine, rate);
        if (!arrive(problem, at, t, fine, rate, &end))
            return GIVEN_UP;
    }
    return REACHED_END;
}
#else
/* A file without declarations is not C. */
typedef int no_bristles;
#endif
