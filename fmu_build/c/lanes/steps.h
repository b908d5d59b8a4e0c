/* A step of the plant, of the members of a vector (c/lanes), or of one platform with WIDTH 1 (c/plant): its end, its error,
   and how the next one is sized. Units and members take the same steps. */
#ifndef STEPS_H
#define STEPS_H

#include "plant_table.h"
#include "vectors.h"

/* Against a division by 0. */
#define SMALLEST_RATE 1e-200

/* Derivatives at a share of the step. */
typedef void find_stage(const void *owner, lanes share, const lanes x[], lanes rate[]);

/* From x with `rate[0]` to `end` after h by an explicit Runge-Kutta method of n stages: row s of A, from 0, has the weights
   before stage s + 1, the last row those of the end. One loop, so that a kernel that is inlined is there once. */
static inline void explicit_step(int n, const double A[][6], lanes h, const lanes x[], lanes rate[][N_STATES],
                                 find_stage *find_rate, const void *owner, lanes end[])
{
    for (int stage = 1; stage <= n; stage++) {
        const double *weights = A[stage - 1];
        double share = 0;
        for (int j = 0; j < stage; j++)
            share += weights[j];
        for (int i = 0; i < N_STATES; i++) {
            lanes slope = (lanes)0.0;
            for (int j = 0; j < stage; j++)
                slope += weights[j] * rate[j][i];
            end[i] = x[i] + h * slope;
        }
        if (stage < n)
            find_rate(owner, (lanes)share, end, rate[stage]);
    }
}

/* Classical RK4, for fixed steps. */
static inline void rk4_step(lanes h, const lanes x[], lanes rate[][N_STATES], find_stage *find_rate, const void *owner,
                            lanes end[])
{
    static const double RK4[4][6] = {{0.5}, {0, 0.5}, {0, 0, 1}, {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}};
    explicit_step(4, RK4, h, x, rate, find_rate, owner, end);
}

#if HAS_BRISTLES
/* ---- legs with stiction ------------------------------------------------------------------------------------------------

   Bristles forget fast: dz/dt = v - d z with rates d of up to 1e5/s. Of them a step takes the linear part -d z exactly,
   with d as it is at its begin: ETDRK4 of S. M. Cox, P. C. Matthews, "Exponential Time Differencing for Stiff Systems", J.
   Comput. Phys. 176(2), 2002, eqs. (26)-(29). For all other states, with d = 0, it is classical RK4. The order is 4 where
   friction is smooth, 2 over a step in which a leg reverses or breaks away: the law has a kink there. */

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

/* The bristle of a leg in a step h: its rate d, functions of -h d, and z and its rate without -d z in the stages. */
typedef struct {
    lanes decay, phi[5];
    lanes half;                /* exp(-h d/2) */
    lanes inner;               /* (h/2) phi_1(-h d/2) */
    lanes first, middle, last; /* h (phi_1 - 3 phi_2 + 4 phi_3), h (2 phi_2 - 4 phi_3), h (4 phi_3 - phi_2) */
    lanes z[4], n[4];
} bristle;

static void find_coefficients(bristle *b, lanes h)
{
    lanes *phi = b->phi, of_half[5];
#if WIDTH == 1
    if (b->decay == 0) { /* a leg that stands: RK4 */
        phi[0] = phi[1] = b->half = 1;
        b->inner = h / 2;
        b->first = b->last = h / 6;
        b->middle = h / 3;
        return;
    }
#endif
    phi_functions(-0.5 * h * b->decay, of_half);
    /* phi_k(2 z) = (exp(z) phi_k(z) + sum of phi_j(z) / (k - j)!, j from 1 to k) / 2^k */
    phi[0] = of_half[0] * of_half[0];
    phi[1] = 0.5 * (of_half[0] * of_half[1] + of_half[1]);
    phi[2] = 0.25 * (of_half[0] * of_half[2] + of_half[1] + of_half[2]);
    phi[3] = 0.125 * (of_half[0] * of_half[3] + 0.5 * of_half[1] + of_half[2] + of_half[3]);
    phi[4] = 0.0625 * (of_half[0] * of_half[4] + (1.0 / 6) * of_half[1] + 0.5 * of_half[2] + of_half[3] + of_half[4]);
    b->half = of_half[0];
    b->inner = 0.5 * h * of_half[1];
    b->first = h * (phi[1] - 3 * phi[2] + 4 * phi[3]);
    b->middle = h * (2 * phi[2] - 4 * phi[3]);
    b->last = h * (4 * phi[3] - phi[2]);
}

/* What a step is made of. */
enum { STAGES = 4 };
typedef struct {
    lanes rate[STAGES + 1][N_STATES]; /* dx/dt in the stages, the first one at the begin, and at the end */
    bristle bristles[N_LEGS];         /* their `decay` at the begin */
} stages;

/* From x with `rate[0]` to `end` after h. */
static inline void take_step(stages *s, lanes h, const lanes x[], find_stage *find_rate, const void *owner, lanes end[])
{
    static const double SHARES[] = {0.5, 0.5, 1};
    lanes(*rate)[N_STATES] = s->rate, at[N_STATES];
    for (int k = 0; k < N_LEGS; k++) {
        find_coefficients(&s->bristles[k], h);
        s->bristles[k].z[0] = x[X_LEG_BRISTLE + k];
    }
    for (int stage = 0; stage < STAGES; stage++) {
        if (stage > 0)
            find_rate(owner, (lanes)SHARES[stage - 1], at, rate[stage]);
        for (int i = 0; stage < 3 && i < N_STATES; i++)
            at[i] = x[i] + (SHARES[stage] * h) * rate[stage][i];
        for (int k = 0; k < N_LEGS; k++) {
            bristle *b = &s->bristles[k];
            b->n[stage] = rate[stage][X_LEG_BRISTLE + k] + b->decay * b->z[stage];
            if (stage < 3)
                at[X_LEG_BRISTLE + k] = b->z[stage + 1] =
                    stage < 2 ? b->half * b->z[0] + b->inner * b->n[stage]
                              : b->half * b->z[1] + b->inner * (2 * b->n[2] - b->n[0]);
        }
    }
    for (int i = 0; i < N_STATES; i++)
        end[i] = x[i] + (h * (1.0 / 6)) * (rate[0][i] + 2 * (rate[1][i] + rate[2][i]) + rate[3][i]);
    for (int k = 0; k < N_LEGS; k++) {
        const bristle *b = &s->bristles[k];
        end[X_LEG_BRISTLE + k] =
            b->phi[0] * b->z[0] + b->first * b->n[0] + b->middle * (b->n[1] + b->n[2]) + b->last * b->n[3];
    }
}

/* The larger one of two estimates of the error of a state.

   With the rate at the end for that of the last stage there is a solution of order 3 that is their difference times h/10
   away (S. Balac, F. Mahe, "Embedded Runge-Kutta scheme for step-size control in the Interaction Picture method", Comput.
   Phys. Commun. 184(4), 2013). It may vanish by chance where a leg reverses or breaks away within the step; so of the
   second difference e2 and the first one e1 of the stages there is e2^3 / (20 (e1 + e2)^2), which falls as h^5, too. */
static inline lanes estimate_of(const stages *s, lanes h, int i, lanes end)
{
    lanes k[STAGES + 1], last = 0.1 * h, all = h;
    for (int stage = 0; stage <= STAGES; stage++)
        k[stage] = s->rate[stage][i];
    if (X_LEG_BRISTLE <= i && i < X_LEG_BRISTLE + N_LEGS) {
        const bristle *b = &s->bristles[i - X_LEG_BRISTLE];
        memcpy(k, b->n, sizeof b->n);
        k[STAGES] += b->decay * end;
        last = 0.6 * b->last;
        all = h * b->phi[1];
    }
    lanes e2 = magnitude((k[0] - k[1]) + (k[3] - k[2])), e1 = magnitude(k[3] - k[0]);
    lanes share = e2 * reciprocal(e1 + e2 + SMALLEST_RATE);
    return larger_of(magnitude(last * (k[3] - k[4])), all * e2 * (share * share) * (1.0 / 20));
}
#else
/* ---- legs that slide --------------------------------------------------------------------------------------------- */

#if HAS_SPRINGS
/* Dormand-Prince 5(4), "A family of embedded Runge-Kutta formulae", J. Comput. Appl. Math. 6 (1980), for oscillations. */
enum { STAGES = 6 };
static const double A[STAGES][6] = {
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
};
#else
/* Kutta's 3/8 rule of order 4, for steps as short as a control loop's. */
enum { STAGES = 4 };
static const double A[STAGES][6] = {{1.0 / 3}, {-1.0 / 3, 1}, {1, -1, 1}, {1.0 / 8, 3.0 / 8, 3.0 / 8, 1.0 / 8}};
#endif

/* What a step is made of. */
typedef struct {
    lanes rate[STAGES + 1][N_STATES]; /* dx/dt in the stages, the first one at the begin, and at the end */
} stages;

/* From x with `rate[0]` to `end` after h. */
static inline void take_step(stages *s, lanes h, const lanes x[], find_stage *find_rate, const void *owner, lanes end[])
{
    explicit_step(STAGES, A, h, x, s->rate, find_rate, owner, end);
}

#if HAS_SPRINGS
/* Half of what is between the solutions of order 5 and 4: the step is of order 5, and this is the error of order 4. */
static inline lanes estimate_of(const stages *s, lanes h, int i, lanes end)
{
    static const double E[] = {71.0 / 57600, 0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    lanes sum = (lanes)0.0;
    (void)end;
    for (int stage = 0; stage <= STAGES; stage++)
        sum += E[stage] * s->rate[stage][i];
    return magnitude(0.5 * h * sum);
}
#else
/* With the rate at the end as fifth stage there is a solution of order 3, e3 = h (k1 - 3 k2 + 3 k3 + 3 k4 - 4 k5) / 24 away
   (Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4, exercise 4). It falls as h^4, the second
   difference e2 = h (k1 - 2 k2 + k3) as h^3 and the first one e1 = h (k2 - k1) as h^2. So their quotients
   e3^2 / (e3 + e2 / 40) and e2^3 / (15 (e1 + e2)^2) fall as h^5 like the error of order 4, of which both are 2.7 times for
   x' = a x (DOP853 has such a quotient, too). The larger one is taken, since each may vanish by chance where a leg slips
   within a step. */
static inline lanes estimate_of(const stages *s, lanes h, int i, lanes end)
{
    lanes k = s->rate[0][i], first = s->rate[1][i] - k, next = s->rate[2][i] - s->rate[1][i];
    lanes e3 = magnitude((k + 3 * (next + s->rate[3][i])) - 4 * s->rate[4][i]) * (1.0 / 24);
    lanes e2 = magnitude(next - first), share = e2 * reciprocal(magnitude(first) + e2 + SMALLEST_RATE);
    (void)end;
    return h * larger_of(e3 * e3 * reciprocal(e3 + e2 * (1.0 / 40) + SMALLEST_RATE),
                         e2 * (share * share) * (1.0 / 15));
}
#endif
#endif

/* ---- error control ------------------------------------------------------------------------------------------------ */

/* The largest error of a step to `end` with the last rate there, of each state relative to |x| plus its scale; NaN if a
   number is not finite. */
static inline lanes error_of_step(const stages *s, lanes h, const lanes x[], const lanes end[])
{
    static const double scales[] = SCALES;
    lanes error = (lanes)0.0, nothing = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        error = larger_of(estimate_of(s, h, i, end[i]) * reciprocal(scales[i] + magnitude(x[i])), error);
        nothing += (end[i] + s->rate[STAGES][i]) * 0;
    }
    return error + nothing;
}

/* By which the next step is longer: about 0.9 r^(-1/5) from 0.2 to 5, within 15 %, of an error r in units of the
   tolerance: a size needs no more, and this is the same on all machines. The bits of a number, as an integer, are 2^52
   (1023 + its logarithm to base 2) but for up to 0.09. */
static inline lanes factor_of(lanes r)
{
    lanes bounded = choose(r <= 2000, r, (lanes)2000.0); /* NaN and infinity become 2000 */
    bounded = choose(bounded >= 1e-4, bounded, (lanes)1e-4);
    lanes logarithm = from_whole(bits(bounded)) * 0x1p-52 - 1023;
    lanes power = (1023 - 0.2 * logarithm) * 0x1p52;
    return larger_of(smaller_of(0.9 * number(to_whole(power)), (lanes)5.0), (lanes)0.2);
}

/* Sizes of the next internal steps: the proposed ones, or what is left, or half of it. */
static inline lanes size_of(lanes proposed, lanes left)
{
    lanes size = choose(proposed * 2 > left, 0.5 * left, proposed);
    return choose(proposed >= left, left, size);
}

/* The size to propose after a step; one that was shortened to end on time says little of the next one. */
static inline lanes proposal_after(lanes proposed, lanes size, lanes ratio)
{
    lanes next = size * factor_of(ratio);
    return choose((ratio <= 1) & (size < proposed) & (next < proposed), proposed, next);
}

#endif
