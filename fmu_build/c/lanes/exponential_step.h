/* The step of plants with bristles, which forget fast: dz/dt = v - d z with rates d of up to 1e5/s. It takes the linear
   part -d z exactly, with d as it is at its begin: ETDRK4 of S. M. Cox, P. C. Matthews, "Exponential Time Differencing for
   Stiff Systems", J. Comput. Phys. 176(2), 2002, eqs. (26)-(29). For all other states, with d = 0, it is classical RK4.
   The order is 4 where friction is smooth, 2 over a step in which a leg reverses or breaks away: the law has a kink there.

   c/lanes steps the members of a vector by it, c/plant one platform: with WIDTH 1. */
#ifndef EXPONENTIAL_STEP_H
#define EXPONENTIAL_STEP_H

#include "plant_table.h"
#include "vectors.h"

/* Below this |z| the functions phi are summed as series, above it taken from exp(z), with at most two digits lost. */
#define SERIES_BELOW 1.0
#define TERMS 18

/* exp(z) as phi[0], and phi_1 to phi_4 of z <= 0: phi_(k+1) = (phi_k - 1/k!) / z; the series sum z^j / (j + k)! near 0,
   which is left out if no member needs it. */
static void phi_functions(lanes z, lanes phi[5])
{
    mask is_small = magnitude(z) < SERIES_BELOW;
    lanes inverse = reciprocal(choose(is_small, (lanes)-1.0, z));
    phi[0] = exp(z);
    phi[1] = (phi[0] - 1) * inverse;
    phi[2] = (phi[1] - 1) * inverse;
    phi[3] = (phi[2] - 0.5) * inverse;
    phi[4] = (phi[3] - 1.0 / 6) * inverse;
    if (!any(is_small))
        return;
    lanes near = choose(is_small, z, (lanes)0.0), sum = (lanes)0.0;
    for (int j = TERMS; j > 4; j--)
        sum = near * (1.0 / j) * (1 + sum);
    lanes third = (1 + near * (1.0 / 4) * (1 + sum)) * (1.0 / 6), second = 0.5 + near * third;
    phi[1] = choose(is_small, 1 + near * second, phi[1]);
    phi[2] = choose(is_small, second, phi[2]);
    phi[3] = choose(is_small, third, phi[3]);
    phi[4] = choose(is_small, (1 + sum) * (1.0 / 24), phi[4]);
}

/* Of a step h and the rates d of the bristles; those but `whole` and `half` in s. */
typedef struct {
    lanes decay[N_LEGS];  /* d [1/s] */
    lanes whole[N_LEGS];  /* exp(-h d) */
    lanes half[N_LEGS];   /* exp(-h d/2) */
    lanes inner[N_LEGS];  /* (h/2) phi_1(-h d/2) */
    lanes first[N_LEGS];  /* h (phi_1 - 3 phi_2 + 4 phi_3) */
    lanes middle[N_LEGS]; /* h (2 phi_2 - 4 phi_3) */
    lanes last[N_LEGS];   /* h (4 phi_3 - phi_2) */
    lanes all[N_LEGS];    /* h phi_1 */
} coefficients;

static void find_coefficients(const lanes decay[N_LEGS], lanes h, coefficients *c)
{
    for (int i = 0; i < N_LEGS; i++) {
        lanes phi[5], of_half[5];
        c->decay[i] = decay[i];
#if WIDTH == 1
        if (decay[i] == 0) { /* a leg that stands: RK4 */
            c->whole[i] = c->half[i] = 1;
            c->inner[i] = h / 2;
            c->first[i] = c->last[i] = h / 6;
            c->middle[i] = h / 3;
            c->all[i] = h;
            continue;
        }
#endif
        phi_functions(-h * decay[i], phi);
        phi_functions(-0.5 * h * decay[i], of_half);
        c->whole[i] = phi[0];
        c->half[i] = of_half[0];
        c->inner[i] = 0.5 * h * of_half[1];
        c->first[i] = h * (phi[1] - 3 * phi[2] + 4 * phi[3]);
        c->middle[i] = h * (2 * phi[2] - 4 * phi[3]);
        c->last[i] = h * (4 * phi[3] - phi[2]);
        c->all[i] = h * phi[1];
    }
}

/* The bristles in the stages of a step: deflections, and their rates without -d z. */
typedef struct {
    lanes z[4][N_LEGS], n[4][N_LEGS];
} bristle_stages;

/* From x with the derivatives `rate[0]` there to `end` after h; `rate` and `bristles` get those of the stages, whose rates
   are asked for at a share of the step. */
static void exponential_step(const coefficients *c, lanes h, const lanes x[N_STATES], lanes rate[][N_STATES],
                             void (*find_rate)(void *owner, lanes share, const lanes x[], lanes rate[]), void *owner,
                             bristle_stages *bristles, lanes end[N_STATES])
{
    static const double SHARES[] = {0.5, 0.5, 1};
    lanes(*z)[N_LEGS] = bristles->z, (*n)[N_LEGS] = bristles->n, at[N_STATES];
    memcpy(at, x, sizeof at);
    for (int stage = 0; stage < 4; stage++) {
        if (stage > 0)
            find_rate(owner, (lanes)SHARES[stage - 1], at, rate[stage]);
        for (int i = 0; i < N_LEGS; i++) {
            z[stage][i] = at[X_LEG_BRISTLE + i];
            n[stage][i] = rate[stage][X_LEG_BRISTLE + i] + c->decay[i] * z[stage][i];
        }
        for (int i = 0; stage < 3 && i < N_STATES; i++)
            at[i] = x[i] + (SHARES[stage] * h) * rate[stage][i];
        for (int i = 0; stage < 3 && i < N_LEGS; i++)
            at[X_LEG_BRISTLE + i] = stage < 2 ? c->half[i] * z[0][i] + c->inner[i] * n[stage][i]
                                              : c->half[i] * z[1][i] + c->inner[i] * (2 * n[2][i] - n[0][i]);
    }
    for (int i = 0; i < N_STATES; i++)
        end[i] = x[i] + (h * (1.0 / 6)) * (rate[0][i] + 2 * (rate[1][i] + rate[2][i]) + rate[3][i]);
    for (int i = 0; i < N_LEGS; i++)
        end[X_LEG_BRISTLE + i] = c->whole[i] * z[0][i] + c->first[i] * n[0][i] +
                                 c->middle[i] * (n[1][i] + n[2][i]) + c->last[i] * n[3][i];
}

#endif
