#include "lanes.h"

#include "conditioning.h"
#include "elementary.h"
#include "lanes_table.h"

/* the generated kernels on `lanes`; included so that the functions above are inlined */
#include "lanes_kernel.h"

#if WIDTH == 1
#define PREFETCH(at)
#else
#define PREFETCH(at) __builtin_prefetch(at)
#endif

static lanes get(const double *from)
{
    return *(const anywhere *)from;
}

static void put(double *to, lanes x)
{
    *(anywhere *)to = x;
}

/* How far a state is from the pose limits: L_i^2, det K and rho^2, see margins_function of model/traced.py. */
typedef struct {
    lanes square[N_LEGS], determinant, size;
} margins;

/* What depends on a state alone: signals, margins, and what the derivatives of the ideal plant need of it besides the
   inputs, or the rates of bristles. */
typedef struct {
    lanes signals[N_SIGNALS];
    margins from_limits;
#if HAS_BRISTLES
    lanes decay[N_LEGS];
#elif !HAS_SPRINGS
    lanes shared[N_SHARED];
#endif
} posed;

/* Eight members during a step. */
typedef struct {
    const batch *of;
    int64_t first; /* member */
    const lanes *p;
    lanes x[N_STATES], u[N_INPUTS], side;
    mask running;
    posed here; /* of x, for error-controlled steps: see `look` */
} group;

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

/* Number of parameters of the geometry, which come first. */
#define N_GEOMETRY P_PLATFORM_MASS

/* Prefetches a block while the one before it is computed. */
static void fetch(const batch *of, int64_t block, int parameters)
{
    if (block >= of->blocks)
        return;
    for (int i = 0; i < parameters; i++)
        PREFETCH(of->parameters + (block * N_PARAMETERS + i) * WIDTH);
    for (int i = 0; i < N_STATES; i++)
        PREFETCH(of->states + i * of->stride + block * WIDTH);
}

/* Reads everything but the inputs; `parameters` is the number of parameters needed. */
static void read_group(group *g, const batch *of, int64_t block, int parameters)
{
    fetch(of, block + 1, parameters);
    g->of = of;
    g->first = block * WIDTH;
    g->p = (const lanes *)of->parameters + block * N_PARAMETERS;
    g->running = *(const mask_anywhere *)(of->running + g->first);
    g->side = get(of->side + g->first);
    read_rows(g->x, N_STATES, of->states + g->first, of->stride);
}

static void read_inputs(group *g)
{
    read_rows(g->u, N_INPUTS, g->of->inputs + g->first, g->of->stride);
}

/* Like check_pose of c/plant/plant.c, for one member: FAILURE_GOES_ON or the reason. */
static int64_t judge(const group *g, int lane, double *side)
{
    double x[N_STATES], p[N_PARAMETERS], length[N_LEGS], rate[N_LEGS], jacobian[N_LEGS][N_LEGS], rho, determinant;
    for (int i = 0; i < N_STATES; i++)
        x[i] = LANE(g->x[i], lane);
    for (int i = 0; i < N_PARAMETERS; i++)
        p[i] = LANE(g->p[i], lane);
    for (int i = 0; i < N_STATES; i++)
        if (!(x[i] - x[i] == 0))
            return FAILURE_NOT_FINITE;
    if (!(-LARGEST_PITCH < x[X_PITCH] && x[X_PITCH] < LARGEST_PITCH))
        return FAILURE_PITCHED;
    kernel_legs(x, p, length, rate, jacobian[0], &rho);
    int shortest = 0;
    for (int i = 1; i < N_LEGS; i++)
        if (length[i] < length[shortest])
            shortest = i;
    if (!(length[shortest] > SHORTEST_LEG * rho))
        return FAILURE_COLLAPSED + shortest;
    double number = condition_number((const double(*)[N_LEGS])jacobian, &determinant);
    double here = determinant > 0 ? 1 : -1;
    if (*side != 0 && *side != here)
        return FAILURE_PASSED_SINGULAR;
    if (!(number < SINGULAR_CONDITION_NUMBER))
        return FAILURE_SINGULAR;
    *side = here;
    return FAILURE_GOES_ON;
}

/* Ends a running member for a reason, `after` a time of the step [s]. */
static void fail(group *g, int lane, int64_t failure, double after, const lanes reached[])
{
    int64_t member = g->first + lane;
    g->of->failure[member] = failure;
    g->of->failed_after[member] = after;
    for (int i = 0; i < N_STATES; i++)
        g->of->reached[i * g->of->stride + member] = LANE(reached[i], lane);
    LANE(g->running, lane) = 0;
}

/* Stops members beyond the pose limits and records the reason. */
static void check(group *g, lanes after, const margins *from_limits)
{
    const lanes *square = from_limits->square, det = from_limits->determinant, size = from_limits->size;
    lanes shortest = square[0], product = square[0], nothing = g->x[0] * 0;
    for (int i = 1; i < N_LEGS; i++) {
        shortest = choose(square[i] < shortest, square[i], shortest);
        product *= square[i];
    }
    for (int i = 1; i < N_STATES; i++)
        nothing += g->x[i] * 0; /* NaN if one of them is not finite */
    lanes here = choose(det > 0, (lanes)1.0, (lanes)-1.0);
    /* kappa <= 2 / |det J| (|J|_F / sqrt n)^n, as in conditioning.c, where |J|_F^2 <= 2 n, since its rows are
       (u, c x u / rho) and the squares of c / rho add up to n: so det J^2 > (16 / limit)^2 is far from singular */
    lanes least = product * (size * size * size) *
                  ((16 / SINGULAR_CONDITION_NUMBER) * (16 / SINGULAR_CONDITION_NUMBER));
    mask passes = (nothing == 0) & (magnitude(g->x[X_PITCH]) < LARGEST_PITCH) &
                  (shortest > (SHORTEST_LEG * SHORTEST_LEG) * size) & (det * det > least) & (g->side * here >= 0);
    mask unsure = g->running & ~passes;
    g->side = choose(g->running & passes, here, g->side);
    if (!any(unsure))
        return;
    for (int lane = 0; lane < WIDTH; lane++) {
        double side = LANE(g->side, lane);
        if (!HOLDS(unsure, lane))
            continue;
        int64_t failure = judge(g, lane, &side);
        LANE(g->side, lane) = side;
        if (failure != FAILURE_GOES_ON)
            fail(g, lane, failure, LANE(after, lane), g->x);
    }
}

static void check_now(group *g, lanes after)
{
    margins m;
    kernel_margins(g->x, g->p, m.square, &m.determinant, &m.size);
    check(g, after, &m);
}

static void look_at(const group *g, const lanes x[], posed *found)
{
    margins *m = &found->from_limits;
#if HAS_BRISTLES
    kernel_posed(x, g->p, found->signals, m->square, &m->determinant, &m->size, found->decay);
#elif HAS_SPRINGS
    kernel_posed(x, g->p, found->signals, m->square, &m->determinant, &m->size);
#else
    kernel_posed(x, g->p, found->signals, m->square, &m->determinant, &m->size, found->shared);
#endif
}

/* The derivatives in a state that has been looked at. */
#if HAS_BRISTLES || HAS_SPRINGS
#define RATES_THERE(there, x, u, p, rate) kernel_derivatives(x, u, p, rate)
#else
#define RATES_THERE(there, x, u, p, rate) kernel_motion((there).shared, x, u, rate)
#endif

/* Evaluates the state where it has not come by `advance`. */
static void look(group *g)
{
    look_at(g, g->x, &g->here);
}

/* The larger one of two numbers without NaN. */
static lanes larger(lanes a, lanes b)
{
    return choose(a > b, a, b);
}

/* Classical RK4: one copy of the kernel in a loop, so that it stays in the instruction cache. */
static void rk4(const group *g, double size, lanes end[])
{
    static const double NEXT[] = {0.5, 0.5, 1}, WEIGHT[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    lanes at[N_STATES], rate[N_STATES];
    for (int i = 0; i < N_STATES; i++)
        at[i] = end[i] = g->x[i];
    for (int stage = 0; stage < 4; stage++) {
        kernel_derivatives(at, g->u, g->p, rate);
        for (int i = 0; i < N_STATES; i++) {
            end[i] += (WEIGHT[stage] * size) * rate[i];
            if (stage < 3)
                at[i] = g->x[i] + (NEXT[stage] * size) * rate[i];
        }
    }
}

/* Writes the states of the members still running; returns the number that failed. */
static int64_t settle(group *g, mask ran)
{
    const batch *of = g->of;
    int64_t failed = 0;
    for (int i = 0; i < N_STATES; i++) {
        double *row = of->states + i * of->stride + g->first;
        g->x[i] = choose(g->running, g->x[i], get(row));
        put(row, g->x[i]);
    }
    put(of->side + g->first, choose(g->running, g->side, get(of->side + g->first)));
    for (int lane = 0; lane < WIDTH; lane++)
        failed += HOLDS(ran, lane) != HOLDS(g->running, lane);
    return failed;
}

static void write_signals(const group *g, double *signals)
{
    lanes y[N_SIGNALS];
    kernel_signals(g->x, g->p, y);
    write_rows(signals + g->first, N_SIGNALS, y, g->of->stride);
}

/* An internal step of Cash-Karp 5(4) of a size: the state at its end, and its error relative to 1 + |x|. */
static void pair(const group *g, lanes size, lanes end[], lanes *error)
{
    static const double A[6][5] = {
        {0},
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {3.0 / 10, -9.0 / 10, 6.0 / 5},
        {-11.0 / 54, 5.0 / 2, -70.0 / 27, 35.0 / 27},
        {1631.0 / 55296, 175.0 / 512, 575.0 / 13824, 44275.0 / 110592, 253.0 / 4096},
    };
    static const double B[] = {37.0 / 378, 0, 250.0 / 621, 125.0 / 594, 0, 512.0 / 1771};
    static const double LOWER[] = {2825.0 / 27648, 0, 18575.0 / 48384, 13525.0 / 55296, 277.0 / 14336, 1.0 / 4};
    lanes at[N_STATES], rate[6][N_STATES];
    for (int stage = 0; stage < 6; stage++) {
        for (int i = 0; i < N_STATES; i++) {
            lanes sum = (lanes)0.0;
            for (int j = 0; j < stage; j++)
                sum += A[stage][j] * rate[j][i];
            at[i] = g->x[i] + size * sum;
        }
        kernel_derivatives(at, g->u, g->p, rate[stage]);
    }
    lanes nothing = (lanes)0.0; /* NaN if one of them is not finite */
    *error = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        lanes sum = (lanes)0.0, gap = (lanes)0.0;
        for (int j = 0; j < 6; j++) {
            sum += B[j] * rate[j][i];
            gap += (B[j] - LOWER[j]) * rate[j][i];
        }
        end[i] = g->x[i] + size * sum;
        *error = larger(size * magnitude(gap) * reciprocal(1 + magnitude(g->x[i])), *error);
        nothing += end[i] * 0;
    }
    *error += nothing;
}

/* Keeps the errors of a step that are larger than those before. */
static void keep_errors(const group *g, lanes error)
{
    double *kept = g->of->error + g->first;
    lanes largest = get(kept);
    error = choose(error == error, error, (lanes)INFINITY);
    put(kept, choose(g->running, larger(error, largest), largest));
}

/* A step of RK4; returns its errors, the distance from Cash-Karp's solution of order 5. */
static lanes fixed_step(group *g, double size)
{
    lanes end[N_STATES], better[N_STATES], error, nothing = (lanes)0.0;
    rk4(g, size, end);
    pair(g, (lanes)size, better, &error);
    error = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        error = larger(magnitude(better[i] - end[i]) * reciprocal(1 + magnitude(end[i])), error);
        nothing += (better[i] - end[i]) * 0;
        g->x[i] = end[i];
    }
    return error + nothing;
}

int64_t lanes_step(const batch *of, double size, int64_t substeps, double *signals)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        lanes error = (lanes)0.0;
        read_group(&g, of, block, N_PARAMETERS);
        read_inputs(&g);
        mask ran = g.running;
        for (int64_t k = 1; k <= substeps && any(g.running); k++) {
            error += fixed_step(&g, size);
            check_now(&g, (lanes)(k * size));
        }
        if (any(ran)) {
            failed += settle(&g, ran);
            keep_errors(&g, error);
        }
        if (signals)
            write_signals(&g, signals);
    }
    return failed;
}

/* About 0.9 r^(-1/5) from 0.2 to 5, within 15 %: a size needs no more, and this is the same on all machines. The bits of
   a number, as an integer, are 2^52 (1023 + its logarithm to base 2) but for up to 0.09. */
static lanes factor_of(lanes r)
{
    lanes known = choose(r <= 2000, r, (lanes)2000.0); /* NaN and infinity become 2000 */
    known = choose(known >= 1e-4, known, (lanes)1e-4);
    lanes logarithm = from_whole(bits(known)) * 0x1p-52 - 1023;
    lanes power = (1023 - 0.2 * logarithm) * 0x1p52;
    lanes factor = 0.9 * number(to_whole(power));
    factor = choose(factor < 5, factor, (lanes)5.0);
    return choose(factor > 0.2, factor, (lanes)0.2);
}

/* Takes what is of another state for members. */
static void keep_posed(posed *kept, const posed *other, mask members)
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

/* Sizes of the members' next internal steps: the proposed ones, or what is left, or half of it. */
static lanes size_of(lanes proposed, lanes left)
{
    lanes size = choose(proposed * 2 > left, 0.5 * left, proposed);
    return choose(proposed >= left, left, size);
}

#if HAS_BRISTLES
#include "exponential_step.h"
#else
/* An internal step by Kutta's 3/8 rule, of order 4, from a state with the derivatives `rate[0]`: the state at its end,
   what depends on that, the derivatives there as `rate[4]`, and the error.

   With these as fifth stage there is a solution of order 3, e3 = h (k1 - 3 k2 + 3 k3 + 3 k4 - 4 k5) / 24 away (Hairer,
   Norsett, Wanner, Solving Ordinary Differential Equations I, II.4, exercise 4). It falls as h^4, the second difference
   e2 = h (k1 - 2 k2 + k3) as h^3 and the first one e1 = h (k2 - k1) as h^2. So their quotients e3^2 / (e3 + e2 / 40) and
   e2^3 / (15 (e1 + e2)^2) fall as h^5 like the error of order 4, of which both are 2.7 times for x' = a x (DOP853 has
   such a quotient, too). The larger one is taken, since each may vanish by chance where a leg slips within a step; of each
   element, relative to 1 + |x|. */
static void controlled_step(const group *g, lanes size, lanes rate[5][N_STATES], lanes end[], posed *there, lanes *error)
{
    lanes at[N_STATES], third = size * (1.0 / 3), nothing = (lanes)0.0; /* NaN if one of them is not finite */
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
    look_at(g, end, there);
    RATES_THERE(*there, end, g->u, g->p, rate[4]);
    *error = (lanes)0.0;
    for (int i = 0; i < N_STATES; i++) {
        const lanes first = rate[1][i] - rate[0][i], next = rate[2][i] - rate[1][i];
        lanes e3 = magnitude((rate[0][i] + 3 * (next + rate[3][i])) - 4 * rate[4][i]) * (1.0 / 24);
        lanes e2 = magnitude(next - first), e1 = magnitude(first);
        lanes one = e3 * e3 * reciprocal(e3 + e2 * (1.0 / 40) + SMALLEST_RATE);
        lanes share = e2 * reciprocal(e1 + e2 + SMALLEST_RATE), other = e2 * (share * share) * (1.0 / 15);
        *error = larger(size * larger(one, other) * reciprocal(1 + magnitude(g->x[i])), *error);
        nothing += (end[i] + rate[4][i]) * 0;
    }
    *error += nothing;
}
#endif

static void advance(group *g, double duration, double tolerance)
{
    const batch *of = g->of;
    lanes left = (lanes)duration, proposed = get(of->proposed + g->first), taken = get(of->internal_steps + g->first);
    lanes sum = (lanes)0.0, begin = taken, rate[5][N_STATES];
    RATES_THERE(g->here, g->x, g->u, g->p, rate[0]);
    mask is_new = proposed == 0;
    proposed = choose(is_new, left, proposed);
    while (any(g->running & (left > 0))) {
        mask active = g->running & (left > 0);
        lanes size = choose(active, size_of(proposed, left), (lanes)0.0), end[N_STATES], error;
        posed there;
        controlled_step(g, size, rate, end, &there, &error);
        lanes ratio = error / tolerance, next = size * factor_of(ratio);
        mask passes = active & (ratio <= 1);
        for (int i = 0; i < N_STATES; i++) {
            g->x[i] = choose(passes, end[i], g->x[i]);
            rate[0][i] = choose(passes, rate[4][i], rate[0][i]);
        }
        keep_posed(&g->here, &there, passes);
        sum = choose(passes, sum + error, sum);
        taken = choose(active, taken + 1, taken);
        /* a step that was shortened to end on time says little of the next one */
        proposed = choose(active, choose(passes & (size < proposed) & (next < proposed), proposed, next), proposed);
        left = choose(passes, choose(size == left, (lanes)0.0, left - size), left);
        lanes after = duration - left;
        if (any(passes))
            check(g, after, &g->here.from_limits);
        mask ends = g->running & (left > 0) &
                    ((taken - begin >= MOST_LANE_STEPS) | (~passes & (proposed < SMALLEST_SHARE * duration)));
        for (int lane = 0; any(ends) && lane < WIDTH; lane++)
            if (HOLDS(ends, lane))
                fail(g, lane, LANE(error, lane) == LANE(error, lane) ? FAILURE_TOO_MANY_STEPS : FAILURE_NOT_FINITE,
                     LANE(after, lane), end);
    }
    put(of->proposed + g->first, choose(g->running, proposed, get(of->proposed + g->first)));
    put(of->internal_steps + g->first, choose(g->running, taken, get(of->internal_steps + g->first)));
    keep_errors(g, sum);
}

int64_t lanes_advance(const batch *of, double duration, double tolerance, double *signals)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        read_group(&g, of, block, N_PARAMETERS);
        read_inputs(&g);
        mask ran = g.running;
        look(&g);
        if (any(ran)) {
            advance(&g, duration, tolerance);
            int64_t of_group = settle(&g, ran);
            failed += of_group;
            if (of_group)
                look(&g);
        }
        if (signals)
            write_rows(signals + g.first, N_SIGNALS, g.here.signals, of->stride);
    }
    return failed;
}

int64_t lanes_check(const batch *of)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        read_group(&g, of, block, N_GEOMETRY);
        mask ran = g.running;
        check_now(&g, (lanes)0.0);
        failed += settle(&g, ran);
    }
    return failed;
}

void lanes_signals(const batch *of, double *signals)
{
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        read_group(&g, of, block, N_GEOMETRY);
        write_signals(&g, signals);
    }
}

void lanes_results(const batch *of, double *results)
{
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        lanes y[N_RESULTS];
        read_group(&g, of, block, N_PARAMETERS);
        read_inputs(&g);
        kernel_outputs(g.x, g.u, g.p, y);
        write_rows(results + g.first, N_RESULTS, y, of->stride);
    }
}

void lanes_derivatives(const batch *of, double *derivatives)
{
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        lanes rate[N_STATES];
        read_group(&g, of, block, N_PARAMETERS);
        read_inputs(&g);
        kernel_derivatives(g.x, g.u, g.p, rate);
        write_rows(derivatives + g.first, N_STATES, rate, of->stride);
    }
}

void lanes_elementary(int64_t blocks, const double *x, double *y)
{
    for (int64_t block = 0; block < blocks; block++) {
        lanes at = get(x + block * WIDTH), found[] = {sin(at), cos(at), tanh(at)};
        write_rows(y + block * WIDTH, 3, found, blocks * WIDTH);
    }
}
