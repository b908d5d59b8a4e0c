#include "conditioning.h"
#include "group.h"

/* the generated kernels on `lanes`; included so that the functions of elementary.h are inlined */
#include "lanes_kernel.h"

#if HAS_BRISTLES
#include "exponential_step.h"
#endif

#if WIDTH == 1
#define PREFETCH(at)
#else
#define PREFETCH(at) __builtin_prefetch(at)
#endif

/* ---- a group of members --------------------------------------------------------------------------------------- */

static void read_rows(lanes rows[], int n, const double *from, int64_t stride)
{
    for (int i = 0; i < n; i++)
        rows[i] = get(from + i * stride);
}

static void write_rows(double *to, int n, const lanes rows[], int64_t stride)
{
    for (int i = 0; i < n; i++)
        put(to + i * stride, rows[i]);
}

void read_group(group *g, const batch *members, int64_t block, int parameters)
{
    int64_t next = block + 1;
    for (int i = 0; next < members->blocks && i < parameters; i++)
        PREFETCH(members->parameters + (next * N_PARAMETERS + i) * WIDTH);
    for (int i = 0; next < members->blocks && i < N_STATES; i++)
        PREFETCH(members->states + i * members->stride + next * WIDTH);
    g->members = members;
    g->first = block * WIDTH;
    g->p = (const lanes *)members->parameters + block * N_PARAMETERS;
    g->running = *(const mask_anywhere *)(members->running + g->first);
    g->side = get(members->side + g->first);
    read_rows(g->x, N_STATES, members->states + g->first, members->stride);
    if (parameters == N_PARAMETERS)
        read_rows(g->u, N_INPUTS, members->inputs + g->first, members->stride);
}

static void evaluate(const group *g, const lanes x[], evaluation *at_x)
{
    pose_margins *m = &at_x->from_limits;
#if HAS_BRISTLES
    kernel_posed(x, g->p, at_x->signals, m->square, &m->determinant, &m->size, at_x->decay);
#elif HAS_SPRINGS
    kernel_posed(x, g->p, at_x->signals, m->square, &m->determinant, &m->size);
#else
    kernel_posed(x, g->p, at_x->signals, m->square, &m->determinant, &m->size, at_x->shared);
#endif
}

void look(group *g) { evaluate(g, g->x, &g->at_x); }

/* The derivatives in a state that has been evaluated. */
static void find_rates(const group *g, const evaluation *at_x, const lanes x[], lanes rate[])
{
#if HAS_BRISTLES || HAS_SPRINGS
    (void)at_x;
    kernel_derivatives(x, g->u, g->p, rate);
#else
    kernel_motion(at_x->shared, x, g->u, rate);
#endif
}

/* Takes the evaluation of another state for members. */
static void take_evaluation(evaluation *kept, const evaluation *other, mask members)
{
    if (!any(~members)) {
        *kept = *other;
        return;
    }
    lanes *to = (lanes *)kept;
    const lanes *from = (const lanes *)other;
    for (size_t i = 0; i < sizeof *kept / sizeof *to; i++)
        to[i] = choose(members, from[i], to[i]);
}

/* Writes the states of the members still running; returns how many have failed. */
static int64_t settle(group *g, mask ran)
{
    const batch *members = g->members;
    int64_t failed = 0;
    for (int i = 0; i < N_STATES; i++) {
        double *row = members->states + i * members->stride + g->first;
        g->x[i] = choose(g->running, g->x[i], get(row));
        put(row, g->x[i]);
    }
    put(members->side + g->first, choose(g->running, g->side, get(members->side + g->first)));
    for (int lane = 0; lane < WIDTH; lane++)
        failed += HOLDS(ran, lane) != HOLDS(g->running, lane);
    return failed;
}

/* Keeps the errors of a step that are larger than those before. */
static void keep_errors(const group *g, lanes error)
{
    double *kept = g->members->error + g->first;
    lanes largest = get(kept);
    error = choose(error == error, error, (lanes)INFINITY);
    put(kept, choose(g->running, larger_of(error, largest), largest));
}

/* ---- limits of the pose --------------------------------------------------------------------------------------- */

/* FAILURE_GOES_ON or the reason, of one member. */
static int64_t judge(const group *g, int lane, double *side)
{
    double x[N_STATES], p[N_PARAMETERS], length[N_LEGS], rate[N_LEGS], jacobian[N_LEGS][N_LEGS], rho;
    for (int i = 0; i < N_STATES; i++)
        x[i] = LANE(g->x[i], lane);
    for (int i = 0; i < N_PARAMETERS; i++)
        p[i] = LANE(g->p[i], lane);
    kernel_legs(x, p, length, rate, jacobian[0], &rho);
    return pose_failure(x, N_STATES, length, (const double(*)[N_LEGS])jacobian, rho, side);
}

/* Ends a running member for a reason, `after` a time of the step [s]. */
static void fail(group *g, int lane, int64_t failure, double after, const lanes reached[])
{
    int64_t member = g->first + lane;
    g->members->failure[member] = failure;
    g->members->failed_after[member] = after;
    for (int i = 0; i < N_STATES; i++)
        g->members->reached[i * g->members->stride + member] = LANE(reached[i], lane);
    LANE(g->running, lane) = 0;
}

/* Stops members beyond the pose limits and records the reason. */
static void check(group *g, lanes after, const pose_margins *from_limits)
{
    const lanes *square = from_limits->square, det = from_limits->determinant, size = from_limits->size;
    lanes shortest = square[0], product = square[0], nothing = g->x[0] * 0;
    for (int i = 1; i < N_LEGS; i++) {
        shortest = choose(square[i] < shortest, square[i], shortest);
        product *= square[i];
    }
    for (int i = 1; i < N_STATES; i++)
        nothing += g->x[i] * 0; /* NaN if one of them is not finite */
    lanes side = choose(det > 0, (lanes)1.0, (lanes)-1.0);
    /* kappa <= 2 / |det J| (|J|_F / sqrt n)^n, as in conditioning.c, where |J|_F^2 <= 2 n, since its rows are
       (u, c x u / rho) and the squares of c / rho add up to n: so det J^2 > (16 / limit)^2 is far from singular */
    lanes least = product * (size * size * size) *
                  ((16 / SINGULAR_CONDITION_NUMBER) * (16 / SINGULAR_CONDITION_NUMBER));
    mask passes = (nothing == 0) & (magnitude(g->x[X_PITCH]) < LARGEST_PITCH) &
                  (shortest > (SHORTEST_LEG * SHORTEST_LEG) * size) & (det * det > least) & (g->side * side >= 0);
    mask unsure = g->running & ~passes;
    g->side = choose(g->running & passes, side, g->side);
    for (int lane = 0; any(unsure) && lane < WIDTH; lane++) {
        if (!HOLDS(unsure, lane))
            continue;
        double judged = LANE(g->side, lane);
        int64_t failure = judge(g, lane, &judged);
        LANE(g->side, lane) = judged;
        if (failure != FAILURE_GOES_ON)
            fail(g, lane, failure, LANE(after, lane), g->x);
    }
}

static void check_now(group *g, lanes after)
{
    pose_margins m;
    kernel_margins(g->x, g->p, m.square, &m.determinant, &m.size);
    check(g, after, &m);
}

/* ---- fixed steps ---------------------------------------------------------------------------------------------- */

/* x + size sum(weight_j rate_j) */
static void combine(const group *g, lanes size, int n, const double weights[], lanes rate[][N_STATES], lanes sum[])
{
    for (int i = 0; i < N_STATES; i++) {
        lanes slope = (lanes)0.0;
        for (int j = 0; j < n; j++)
            slope += weights[j] * rate[j][i];
        sum[i] = g->x[i] + size * slope;
    }
}

/* The rates of an explicit Runge-Kutta method in its stages from `first` on: one copy of the kernel in a loop, so that it
   stays in the instruction cache. */
static void find_stages(const group *g, lanes size, int first, int n, const double A[][5], lanes rate[][N_STATES])
{
    lanes at[N_STATES];
    for (int stage = first; stage < n; stage++) {
        combine(g, size, stage, A[stage], rate, at);
        kernel_derivatives(at, g->u, g->p, rate[stage]);
    }
}

/* A step of classical RK4; returns its errors, the distance from the solution of order 5 by Cash and Karp. */
static lanes rk4_step(group *g, double size)
{
    static const double A4[4][5] = {{0}, {0.5}, {0, 0.5}, {0, 0, 1}};
    static const double B4[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    static const double A5[6][5] = {
        {0},
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {3.0 / 10, -9.0 / 10, 6.0 / 5},
        {-11.0 / 54, 5.0 / 2, -70.0 / 27, 35.0 / 27},
        {1631.0 / 55296, 175.0 / 512, 575.0 / 13824, 44275.0 / 110592, 253.0 / 4096},
    };
    static const double B5[] = {37.0 / 378, 0, 250.0 / 621, 125.0 / 594, 0, 512.0 / 1771};
    lanes rate[6][N_STATES], better[N_STATES], error = (lanes)0.0, nothing = (lanes)0.0;
    find_stages(g, (lanes)size, 0, 6, A5, rate);
    combine(g, (lanes)size, 6, B5, rate, better);
    find_stages(g, (lanes)size, 1, 4, A4, rate);
    combine(g, (lanes)size, 4, B4, rate, g->x);
    for (int i = 0; i < N_STATES; i++) {
        error = larger_of(magnitude(better[i] - g->x[i]) * reciprocal(1 + magnitude(g->x[i])), error);
        nothing += (better[i] - g->x[i]) * 0;
    }
    return error + nothing;
}

int64_t step_fixed(group *g, double size, int64_t substeps)
{
    lanes error = (lanes)0.0;
    mask ran = g->running;
    for (int64_t k = 1; k <= substeps && any(g->running); k++) {
        error += rk4_step(g, size);
        check_now(g, (lanes)((double)k * size));
    }
    int64_t failed = settle(g, ran);
    keep_errors(g, error);
    kernel_signals(g->x, g->p, g->at_x.signals);
    return failed;
}

/* ---- error-controlled steps ----------------------------------------------------------------------------------- */

#if HAS_BRISTLES
static void rates_in_stage(void *owner, lanes share, const lanes x[], lanes rate[])
{
    const group *g = owner;
    (void)share; /* the inputs are constant */
    kernel_derivatives(x, g->u, g->p, rate);
}

/* The larger one of two estimates of an error, for a weight of the first and a length h of the step.

   `rate[3]` and `rate[4]` are the rates of the last stage and at the end, with which there is a solution of order 3 that
   is (4 - 5) h / 10 away (S. Balac, F. Mahe, "Embedded Runge-Kutta scheme for step-size control in the Interaction Picture
   method", Comput. Phys. Commun. 184(4), 2013). It may vanish by chance where a leg reverses or breaks away within the
   step; so of the second difference e2 and the first one e1 of the stages there is e2^3 / (20 (e1 + e2)^2), which falls
   as h^5, too, see `controlled_step` of plants without bristles. */
static lanes error_of(const lanes rate[5], lanes last, lanes all)
{
    lanes e2 = magnitude((rate[0] - rate[1]) + (rate[3] - rate[2])), e1 = magnitude(rate[3] - rate[0]);
    lanes share = e2 * reciprocal(e1 + e2 + SMALLEST_RATE);
    return larger_of(magnitude(last * (rate[3] - rate[4])), all * e2 * (share * share) * (1.0 / 20));
}

/* An internal step by exponential_step.h: the state at its end, its evaluation, the derivatives there as `rate[4]`, and the
   error, of each element relative to |x| plus its scale. */
static void controlled_step(group *g, lanes size, lanes rate[5][N_STATES], lanes end[], evaluation *at_end, lanes *error)
{
    static const double scales[] = SCALES;
    lanes nothing = (lanes)0.0; /* NaN if a number is not finite */
    coefficients c;
    bristle_stages bristles;
    find_coefficients(g->at_x.decay, size, &c);
    exponential_step(&c, size, g->x, rate, rates_in_stage, g, &bristles, end);
    evaluate(g, end, at_end);
    find_rates(g, at_end, end, rate[4]);
    *error = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        int leg = i - X_LEG_BRISTLE, is_bristle = 0 <= leg && leg < N_LEGS;
        lanes slopes[5], last = 0.1 * size, all = size;
        for (int k = 0; k < 5; k++)
            slopes[k] = rate[k][i];
        if (is_bristle) {
            for (int k = 0; k < 4; k++)
                slopes[k] = bristles.n[k][leg];
            slopes[4] += c.decay[leg] * end[i];
            last = 0.6 * c.last[leg];
            all = c.all[leg];
        }
        lanes largest = error_of(slopes, last, all);
        *error = larger_of(largest * reciprocal(scales[i] + magnitude(g->x[i])), *error);
        nothing += (end[i] + rate[4][i]) * 0;
    }
    *error += nothing;
}
#else
/* An internal step by Kutta's 3/8 rule, of order 4, from a state with the derivatives `rate[0]`: the state at its end,
   its evaluation, the derivatives there as `rate[4]`, and the error.

   With these as fifth stage there is a solution of order 3, e3 = h (k1 - 3 k2 + 3 k3 + 3 k4 - 4 k5) / 24 away (Hairer,
   Norsett, Wanner, Solving Ordinary Differential Equations I, II.4, exercise 4). It falls as h^4, the second difference
   e2 = h (k1 - 2 k2 + k3) as h^3 and the first one e1 = h (k2 - k1) as h^2. So their quotients e3^2 / (e3 + e2 / 40) and
   e2^3 / (15 (e1 + e2)^2) fall as h^5 like the error of order 4, of which both are 2.7 times for x' = a x (DOP853 has
   such a quotient, too). The larger one is taken, since each may vanish by chance where a leg slips within a step; of each
   element, relative to 1 + |x|. */
static void controlled_step(group *g, lanes size, lanes rate[5][N_STATES], lanes end[], evaluation *at_end, lanes *error)
{
    lanes at[N_STATES], third = size * (1.0 / 3), nothing = (lanes)0.0; /* NaN if a number is not finite */
    for (int i = 0; i < N_STATES; i++)
        at[i] = g->x[i] + third * rate[0][i];
    kernel_derivatives(at, g->u, g->p, rate[1]);
    for (int i = 0; i < N_STATES; i++)
        at[i] = g->x[i] + (size * rate[1][i] - third * rate[0][i]);
    kernel_derivatives(at, g->u, g->p, rate[2]);
    for (int i = 0; i < N_STATES; i++)
        at[i] = g->x[i] + size * ((rate[0][i] - rate[1][i]) + rate[2][i]);
    kernel_derivatives(at, g->u, g->p, rate[3]);
    for (int i = 0; i < N_STATES; i++)
        end[i] = g->x[i] + (size * 0.125) * ((rate[0][i] + rate[3][i]) + 3 * (rate[1][i] + rate[2][i]));
    evaluate(g, end, at_end);
    find_rates(g, at_end, end, rate[4]);
    *error = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        const lanes first = rate[1][i] - rate[0][i], next = rate[2][i] - rate[1][i];
        lanes e3 = magnitude((rate[0][i] + 3 * (next + rate[3][i])) - 4 * rate[4][i]) * (1.0 / 24);
        lanes e2 = magnitude(next - first), e1 = magnitude(first);
        lanes one = e3 * e3 * reciprocal(e3 + e2 * (1.0 / 40) + SMALLEST_RATE);
        lanes share = e2 * reciprocal(e1 + e2 + SMALLEST_RATE), other = e2 * (share * share) * (1.0 / 15);
        *error = larger_of(size * larger_of(one, other) * reciprocal(1 + magnitude(g->x[i])), *error);
        nothing += (end[i] + rate[4][i]) * 0;
    }
    *error += nothing;
}
#endif

/* About 0.9 r^(-1/5) from 0.2 to 5, within 15 %: a size needs no more, and this is the same on all machines. The bits of
   a number, as an integer, are 2^52 (1023 + its logarithm to base 2) but for up to 0.09. */
static lanes factor_of(lanes r)
{
    lanes bounded = choose(r <= 2000, r, (lanes)2000.0); /* NaN and infinity become 2000 */
    bounded = choose(bounded >= 1e-4, bounded, (lanes)1e-4);
    lanes logarithm = from_whole(bits(bounded)) * 0x1p-52 - 1023;
    lanes power = (1023 - 0.2 * logarithm) * 0x1p52;
    return larger_of(smaller_of(0.9 * number(to_whole(power)), (lanes)5.0), (lanes)0.2);
}

/* Sizes of the members' next internal steps: the proposed ones, or what is left, or half of it. */
static lanes size_of(lanes proposed, lanes left)
{
    lanes size = choose(proposed * 2 > left, 0.5 * left, proposed);
    return choose(proposed >= left, left, size);
}

int64_t step_controlled(group *g, double duration, double tolerance)
{
    double *kept_size = g->members->proposed + g->first, *kept_count = g->members->internal_steps + g->first;
    lanes left = (lanes)duration, proposed = get(kept_size), taken = get(kept_count);
    lanes sum = (lanes)0.0, begin = taken, rate[5][N_STATES];
    mask ran = g->running;
    find_rates(g, &g->at_x, g->x, rate[0]);
    proposed = choose(proposed == 0, left, proposed);
    while (any(g->running & (left > 0))) {
        mask active = g->running & (left > 0);
        lanes size = choose(active, size_of(proposed, left), (lanes)0.0), end[N_STATES], error;
        evaluation at_end;
        controlled_step(g, size, rate, end, &at_end, &error);
        lanes ratio = error / tolerance, next = size * factor_of(ratio);
        mask passes = active & (ratio <= 1);
        for (int i = 0; i < N_STATES; i++) {
            g->x[i] = choose(passes, end[i], g->x[i]);
            rate[0][i] = choose(passes, rate[4][i], rate[0][i]);
        }
        take_evaluation(&g->at_x, &at_end, passes);
        sum = choose(passes, sum + error, sum);
        taken = choose(active, taken + 1, taken);
        /* a step that was shortened to end on time says little of the next one */
        proposed = choose(active, choose(passes & (size < proposed) & (next < proposed), proposed, next), proposed);
        left = choose(passes, choose(size == left, (lanes)0.0, left - size), left);
        lanes after = duration - left;
        if (any(passes))
            check(g, after, &g->at_x.from_limits);
        mask ends = g->running & (left > 0) &
                    ((taken - begin >= MOST_LANE_STEPS) | (~passes & (proposed < SMALLEST_SHARE * duration)));
        for (int lane = 0; any(ends) && lane < WIDTH; lane++)
            if (HOLDS(ends, lane))
                fail(g, lane, LANE(error, lane) == LANE(error, lane) ? FAILURE_TOO_MANY_STEPS : FAILURE_NOT_FINITE,
                     LANE(after, lane), end);
    }
    put(kept_size, choose(g->running, proposed, get(kept_size)));
    put(kept_count, choose(g->running, taken, get(kept_count)));
    keep_errors(g, sum);
    int64_t failed = settle(g, ran);
    if (failed)
        look(g);
    return failed;
}

/* ---- all members ---------------------------------------------------------------------------------------------- */

int64_t lanes_step(const batch *members, double size, int64_t substeps, double *signals)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < members->blocks; block++) {
        group g;
        read_group(&g, members, block, N_PARAMETERS);
        failed += step_fixed(&g, size, substeps);
        if (signals)
            write_rows(signals + g.first, N_SIGNALS, g.at_x.signals, members->stride);
    }
    return failed;
}

int64_t lanes_advance(const batch *members, double duration, double tolerance, double *signals)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < members->blocks; block++) {
        group g;
        read_group(&g, members, block, N_PARAMETERS);
        look(&g);
        if (any(g.running))
            failed += step_controlled(&g, duration, tolerance);
        if (signals)
            write_rows(signals + g.first, N_SIGNALS, g.at_x.signals, members->stride);
    }
    return failed;
}

int64_t lanes_check(const batch *members)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < members->blocks; block++) {
        group g;
        read_group(&g, members, block, N_GEOMETRY);
        mask ran = g.running;
        check_now(&g, (lanes)0.0);
        failed += settle(&g, ran);
    }
    return failed;
}

static void find_signals(const group *g, lanes signals[]) { kernel_signals(g->x, g->p, signals); }
static void find_derivatives(const group *g, lanes rate[]) { kernel_derivatives(g->x, g->u, g->p, rate); }
void find_results(const group *g, lanes results[]) { kernel_outputs(g->x, g->u, g->p, results); }

/* What there is of the states of all members: rows (n, M). */
static void write_all(const batch *members, int parameters, void (*find)(const group *, lanes[]), int n, double *rows)
{
    for (int64_t block = 0; block < members->blocks; block++) {
        group g;
        lanes y[N_RESULTS];
        read_group(&g, members, block, parameters);
        find(&g, y);
        write_rows(rows + g.first, n, y, members->stride);
    }
}

void lanes_signals(const batch *members, double *signals)
{
    write_all(members, N_GEOMETRY, find_signals, N_SIGNALS, signals);
}

void lanes_results(const batch *members, double *results)
{
    write_all(members, N_PARAMETERS, find_results, N_RESULTS, results);
}

void lanes_derivatives(const batch *members, double *derivatives)
{
    write_all(members, N_PARAMETERS, find_derivatives, N_STATES, derivatives);
}

void lanes_elementary(int64_t blocks, const double *x, double *y)
{
    for (int64_t block = 0; block < blocks; block++) {
        lanes at = get(x + block * WIDTH), values[] = {sin(at), cos(at), tanh(at)};
        write_rows(y + block * WIDTH, 3, values, blocks * WIDTH);
    }
}
