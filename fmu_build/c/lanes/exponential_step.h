/* The internal step of plants with bristles, which forget fast: dz/dt = v - d z with rates d of up to 1e5/s. It takes the
   linear part -d z exactly, with d as it is at its begin: ETDRK4 of S. M. Cox, P. C. Matthews, "Exponential Time
   Differencing for Stiff Systems", J. Comput. Phys. 176(2), 2002, eqs. (26)-(29), as model/exponential.py. For all other
   states, with d = 0, it is classical RK4.

   Included by lanes.c. */

/* Below this |z| the functions phi are summed as series, above it taken from exp(z), with at most two digits lost. */
#define SERIES_BELOW 1.0
#define TERMS 18

/* exp(z) and phi_1 to phi_3 of z <= 0: phi_(k+1) = (phi_k - 1/k!) / z; the series sum z^j / (j + k)! near 0. */
static void phi_functions(lanes z, lanes found[4])
{
    mask is_small = magnitude(z) < SERIES_BELOW;
    lanes near = choose(is_small, z, (lanes)0.0), far = reciprocal(choose(is_small, (lanes)-1.0, z));
    lanes third = (lanes)0.0;
    for (int j = TERMS; j > 3; j--)
        third = near * (1.0 / j) * (1 + third);
    third = (1 + third) * (1.0 / 6);
    lanes second = 0.5 + near * third;
    found[0] = exp(z);
    lanes one = (found[0] - 1) * far, two = (one - 1) * far;
    found[1] = choose(is_small, 1 + near * second, one);
    found[2] = choose(is_small, second, two);
    found[3] = choose(is_small, third, (two - 0.5) * far);
}

/* Of a step h and the rate d of a bristle; those but `whole` and `half` in s. */
typedef struct {
    lanes whole, half;         /* exp(-h d), exp(-h d / 2) */
    lanes inner;               /* (h / 2) phi_1(-h d / 2) */
    lanes first, middle, last; /* h (phi_1 - 3 phi_2 + 4 phi_3), h (2 phi_2 - 4 phi_3), h (4 phi_3 - phi_2) */
    lanes all;                 /* h phi_1 */
} coefficients;

static void coefficients_of(lanes h, lanes decay, coefficients *c)
{
    lanes of_half[4], of_whole[4];
    phi_functions(-0.5 * h * decay, of_half);
    phi_functions(-h * decay, of_whole);
    c->half = of_half[0];
    c->inner = 0.5 * h * of_half[1];
    c->whole = of_whole[0];
    c->all = h * of_whole[1];
    c->first = h * (of_whole[1] - 3 * of_whole[2] + 4 * of_whole[3]);
    c->middle = h * (2 * of_whole[2] - 4 * of_whole[3]);
    c->last = h * (4 * of_whole[3] - of_whole[2]);
}

/* x + weight rate, but for the bristles. */
static void stage(const lanes x[], lanes weight, const lanes rate[], const lanes bristle[], lanes found[])
{
    for (int i = 0; i < N_STATES; i++)
        found[i] = x[i] + weight * rate[i];
    for (int i = 0; i < N_LEGS; i++)
        found[X_LEG_BRISTLE + i] = bristle[i];
}

/* The larger one of two estimates of an error, for a weight of the first and a length h of the step.

   `four` and `five` are the rates of the last stage and at the end, with which there is a solution of order 3 that is
   (4 - 5) h / 10 away (S. Balac, F. Mahe, "Embedded Runge-Kutta scheme for step-size control in the Interaction Picture
   method", Comput. Phys. Commun. 184(4), 2013). It may vanish by chance where a leg reverses or breaks away within the
   step; so of the second difference e2 and the first one e1 of the stages there is e2^3 / (20 (e1 + e2)^2), which falls
   as h^5, too, see `controlled_step` of plants without bristles. */
static lanes error_of(const lanes n[5], lanes last, lanes all)
{
    lanes e2 = magnitude((n[0] - n[1]) + (n[3] - n[2])), e1 = magnitude(n[3] - n[0]);
    lanes share = e2 * reciprocal(e1 + e2 + SMALLEST_RATE);
    return larger(magnitude(last * (n[3] - n[4])), all * e2 * (share * share) * (1.0 / 20));
}

/* The state at the end of an internal step, what depends on that, the derivatives there as `rate[4]`, and the error, of
   each element relative to |x| plus its scale. */
static void controlled_step(const group *g, lanes size, lanes rate[5][N_STATES], lanes end[], posed *there, lanes *error)
{
    static const double scales[] = SCALES;
    const lanes *z = g->x + X_LEG_BRISTLE, *d = g->here.decay;
    /* deflections in the stages, and their rates without -d z */
    lanes za[N_LEGS], zb[N_LEGS], zc[N_LEGS], ze[N_LEGS], n[N_LEGS][5], at[N_STATES], sum[N_STATES];
    lanes nothing = (lanes)0.0; /* NaN if a number is not finite */
    coefficients c[N_LEGS];
    for (int i = 0; i < N_LEGS; i++) {
        coefficients_of(size, d[i], &c[i]);
        n[i][0] = rate[0][X_LEG_BRISTLE + i] + d[i] * z[i];
        za[i] = c[i].half * z[i] + c[i].inner * n[i][0];
    }
    stage(g->x, 0.5 * size, rate[0], za, at);
    kernel_derivatives(at, g->u, g->p, rate[1]);
    for (int i = 0; i < N_LEGS; i++) {
        n[i][1] = rate[1][X_LEG_BRISTLE + i] + d[i] * za[i];
        zb[i] = c[i].half * z[i] + c[i].inner * n[i][1];
    }
    stage(g->x, 0.5 * size, rate[1], zb, at);
    kernel_derivatives(at, g->u, g->p, rate[2]);
    for (int i = 0; i < N_LEGS; i++) {
        n[i][2] = rate[2][X_LEG_BRISTLE + i] + d[i] * zb[i];
        zc[i] = c[i].half * za[i] + c[i].inner * (2 * n[i][2] - n[i][0]);
    }
    stage(g->x, size, rate[2], zc, at);
    kernel_derivatives(at, g->u, g->p, rate[3]);
    for (int i = 0; i < N_LEGS; i++) {
        n[i][3] = rate[3][X_LEG_BRISTLE + i] + d[i] * zc[i];
        ze[i] = c[i].whole * z[i] + c[i].first * n[i][0] + c[i].middle * (n[i][1] + n[i][2]) + c[i].last * n[i][3];
    }
    for (int i = 0; i < N_STATES; i++)
        sum[i] = rate[0][i] + 2 * (rate[1][i] + rate[2][i]) + rate[3][i];
    stage(g->x, size * (1.0 / 6), sum, ze, end);
    look_at(g, end, there);
    RATES_THERE(*there, end, g->u, g->p, rate[4]);
    *error = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        int leg = i - X_LEG_BRISTLE;
        lanes found;
        if (0 <= leg && leg < N_LEGS) {
            n[leg][4] = rate[4][i] + d[leg] * ze[leg];
            found = error_of(n[leg], 0.6 * c[leg].last, c[leg].all);
        } else {
            const lanes own[] = {rate[0][i], rate[1][i], rate[2][i], rate[3][i], rate[4][i]};
            found = error_of(own, 0.1 * size, size);
        }
        *error = larger(found * reciprocal(scales[i] + magnitude(g->x[i])), *error);
        nothing += (end[i] + rate[4][i]) * 0;
    }
    *error += nothing;
}
