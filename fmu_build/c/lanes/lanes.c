#include "conditioning.h"
#include "lanes.h"

/* the generated kernels on `lanes`; included so that the functions of elementary.h are inlined */
#include "lanes_kernel.h"

#include "steps.h"

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
    evaluate(g, g->x, &g->at_x);
}

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

/* Writes what a step with these errors did to the members still running, and looks at the others where they were; returns
   how many have failed. */
static int64_t settle(group *g, mask ran, lanes error)
{
    const batch *members = g->members;
    double *side = members->side + g->first, *largest = members->error + g->first;
    int64_t failed = 0;
    for (int i = 0; i < N_STATES; i++) {
        double *row = members->states + i * members->stride + g->first;
        g->x[i] = choose(g->running, g->x[i], get(row));
        put(row, g->x[i]);
    }
    put(side, choose(g->running, g->side, get(side)));
    error = choose(error == error, error, (lanes)INFINITY);
    put(largest, choose(g->running, larger_of(error, get(largest)), get(largest)));
    for (int lane = 0; lane < WIDTH; lane++)
        failed += HOLDS(ran, lane) != HOLDS(g->running, lane);
    if (failed)
        evaluate(g, g->x, &g->at_x);
    return failed;
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

/* ---- steps ---------------------------------------------------------------------------------------------------- */

/* The inputs are constant. One copy of the kernel, so that it stays in the instruction cache. */
static void find_stage_rates(const void *owner, lanes share, const lanes x[], lanes rate[])
{
    const group *g = owner;
    (void)share;
    kernel_derivatives(x, g->u, g->p, rate);
}

/* The distance of the end of a step from the solution of order 5 by Cash and Karp. */
static lanes distance_from_fifth_order(const group *g, lanes size, const lanes first_rate[], const lanes end[])
{
    static const double CASH_KARP[6][6] = {
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {3.0 / 10, -9.0 / 10, 6.0 / 5},
        {-11.0 / 54, 5.0 / 2, -70.0 / 27, 35.0 / 27},
        {1631.0 / 55296, 175.0 / 512, 575.0 / 13824, 44275.0 / 110592, 253.0 / 4096},
        {37.0 / 378, 0, 250.0 / 621, 125.0 / 594, 0, 512.0 / 1771},
    };
    lanes rate[6][N_STATES], better[N_STATES], error = (lanes)0.0, nothing = (lanes)0.0;
    memcpy(rate[0], first_rate, sizeof rate[0]);
    explicit_step(6, CASH_KARP, size, g->x, rate, find_stage_rates, g, better);
    for (int i = 0; i < N_STATES; i++) {
        error = larger_of(magnitude(better[i] - end[i]) * reciprocal(1 + magnitude(end[i])), error);
        nothing += (better[i] - end[i]) * 0;
    }
    return error + nothing;
}

int64_t step_fixed(group *g, double size, int64_t substeps)
{
    lanes sum = (lanes)0.0, end[N_STATES];
    lanes rate[4][N_STATES];
    mask ran = g->running;
    for (int64_t k = 1; k <= substeps && any(g->running); k++) {
        find_rates(g, &g->at_x, g->x, rate[0]);
        rk4_step((lanes)size, g->x, rate, find_stage_rates, g, end);
        sum += distance_from_fifth_order(g, (lanes)size, rate[0], end);
        for (int i = 0; i < N_STATES; i++)
            g->x[i] = choose(g->running, end[i], g->x[i]);
        evaluate(g, g->x, &g->at_x);
        check(g, (lanes)((double)k * size), &g->at_x.from_limits);
    }
    return settle(g, ran, sum);
}

int64_t step_controlled(group *g, double duration, double tolerance)
{
    double *kept_size = g->members->proposed + g->first, *kept_count = g->members->internal_steps + g->first;
    lanes left = (lanes)duration, proposed = get(kept_size), taken = get(kept_count);
    lanes sum = (lanes)0.0, begin = taken, end[N_STATES];
    mask ran = g->running;
    stages s;
    find_rates(g, &g->at_x, g->x, s.rate[0]);
    proposed = choose(proposed == 0, left, proposed);
    while (any(g->running & (left > 0))) {
        mask active = g->running & (left > 0);
        lanes size = choose(active, size_of(proposed, left), (lanes)0.0);
        evaluation at_end;
#if HAS_BRISTLES
        for (int k = 0; k < N_LEGS; k++)
            s.bristles[k].decay = g->at_x.decay[k];
#endif
        take_step(&s, size, g->x, find_stage_rates, g, end);
        evaluate(g, end, &at_end);
        find_rates(g, &at_end, end, s.rate[STAGES]);
        lanes error = error_of_step(&s, size, g->x, end), ratio = error / tolerance;
        mask passes = active & (ratio <= 1);
        for (int i = 0; i < N_STATES; i++) {
            g->x[i] = choose(passes, end[i], g->x[i]);
            s.rate[0][i] = choose(passes, s.rate[STAGES][i], s.rate[0][i]);
        }
        take_evaluation(&g->at_x, &at_end, passes);
        sum = choose(passes, sum + error, sum);
        taken = choose(active, taken + 1, taken);
        proposed = choose(active, proposal_after(proposed, size, ratio), proposed);
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
    return settle(g, ran, sum);
}

/* ---- all members ---------------------------------------------------------------------------------------------- */

int64_t lanes_step(const batch *members, double size, int64_t substeps, double tolerance, double *signals)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < members->blocks; block++) {
        group g;
        read_group(&g, members, block, N_PARAMETERS);
        if (any(g.running))
            failed += substeps ? step_fixed(&g, size, substeps) : step_controlled(&g, size, tolerance);
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
        check(&g, (lanes)0.0, &g.at_x.from_limits);
        failed += settle(&g, ran, (lanes)0.0);
    }
    return failed;
}

void find_results(const group *g, lanes results[]) { kernel_outputs(g->x, g->u, g->p, results); }

void lanes_results(const batch *members, double *results)
{
    for (int64_t block = 0; block < members->blocks; block++) {
        group g;
        lanes y[N_RESULTS];
        read_group(&g, members, block, N_PARAMETERS);
        find_results(&g, y);
        write_rows(results + g.first, N_RESULTS, y, members->stride);
    }
}

void lanes_elementary(int64_t blocks, const double *x, double *y)
{
    for (int64_t block = 0; block < blocks; block++) {
        lanes at = get(x + block * WIDTH), values[] = {sin(at), cos(at), tanh(at)};
        write_rows(y + block * WIDTH, 3, values, blocks * WIDTH);
    }
}
