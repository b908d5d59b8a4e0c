#include "lanes.h"

#include "conditioning.h"
#include "elementary.h"
#include "lanes_table.h"

/* the generated kernels on `lanes`; included so that the functions above are inlined */
#include "lanes_kernel.h"

typedef double anywhere __attribute__((ext_vector_type(WIDTH), aligned(8)));
typedef int64_t mask_anywhere __attribute__((ext_vector_type(WIDTH), aligned(8)));

static lanes get(const double *from)
{
    return *(const anywhere *)from;
}

static void put(double *to, lanes x)
{
    *(anywhere *)to = x;
}

static int any(mask which)
{
    return __builtin_reduce_or(which) != 0;
}

/* Eight members during a step. */
typedef struct {
    const batch *of;
    int64_t first; /* member */
    const lanes *p;
    lanes x[N_STATES], u[N_INPUTS], side;
    lanes difference; /* of the stages, relative to 1 + |x|, the largest of the substeps */
    mask running;
} group;

/* Members whose step is repeated with twice as many substeps: collected from all groups, so that vectors are full. */
typedef struct {
    group g;
    lanes p[N_PARAMETERS], end[N_STATES];
    int64_t member[WIDTH];
    int waiting;
} repeated;

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
        __builtin_prefetch(of->parameters + (block * N_PARAMETERS + i) * WIDTH);
    for (int i = 0; i < N_STATES; i++)
        __builtin_prefetch(of->states + i * of->stride + block * WIDTH);
}

/* Reads everything but the inputs; `parameters` is the number of parameters needed. */
static void read_group(group *g, const batch *of, int64_t block, int parameters)
{
    fetch(of, block + 1, parameters);
    g->of = of;
    g->first = block * WIDTH;
    g->difference = (lanes)0.0;
    g->p = (const lanes *)of->parameters + block * N_PARAMETERS;
    g->running = *(const mask_anywhere *)(of->running + g->first);
    g->side = get(of->side + g->first);
    read_rows(g->x, N_STATES, of->states + g->first, of->stride);
}

static void read_inputs(group *g)
{
    read_rows(g->u, N_INPUTS, g->of->inputs + g->first, g->of->stride);
}

/* Like check_pose of c/plant/pose_limits.c, for one member: FAILURE_GOES_ON or the reason. */
static int64_t judge(const group *g, int lane, double *side)
{
    double x[N_STATES], p[N_PARAMETERS], length[N_LEGS], rate[N_LEGS], jacobian[N_LEGS][N_LEGS], rho, determinant;
    for (int i = 0; i < N_STATES; i++)
        x[i] = g->x[i][lane];
    for (int i = 0; i < N_PARAMETERS; i++)
        p[i] = g->p[i][lane];
    for (int i = 0; i < N_STATES; i++)
        if (!__builtin_isfinite(x[i]))
            return FAILURE_NOT_FINITE;
    if (!(__builtin_fabs(x[X_PITCH]) < LARGEST_PITCH))
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

/* Stops members beyond the pose limits and records the reason. */
static void check(group *g, int64_t substep)
{
    lanes square[N_LEGS], det, size;
    kernel_margins(g->x, g->p, square, &det, &size);
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
    mask passes = (nothing == 0) & (__builtin_elementwise_abs(g->x[X_PITCH]) < LARGEST_PITCH) &
                  (shortest > (SHORTEST_LEG * SHORTEST_LEG) * size) & (det * det > least) & (g->side * here >= 0);
    mask unsure = g->running & ~passes;
    g->side = choose(g->running & passes, here, g->side);
    if (!any(unsure))
        return;
    for (int lane = 0; lane < WIDTH; lane++) {
        double side = g->side[lane];
        if (!unsure[lane])
            continue;
        int64_t failure = judge(g, lane, &side), member = g->first + lane;
        g->side[lane] = side;
        if (failure != FAILURE_GOES_ON) {
            g->of->failure[member] = failure;
            g->of->failed_at[member] = substep;
            for (int i = 0; i < N_STATES; i++)
                g->of->reached[i * g->of->stride + member] = g->x[i][lane];
            g->running[lane] = 0;
        }
    }
}

/* The larger one of two numbers without NaN. */
static lanes larger(lanes a, lanes b)
{
    return choose(a > b, a, b);
}

static lanes magnitude(lanes x)
{
    return __builtin_elementwise_abs(x);
}

/* Classical RK4: one copy of the kernel in a loop, so that it stays in the instruction cache. */
static void substep(group *g, double size)
{
    static const double NEXT[] = {0.5, 0.5, 1}, WEIGHT[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    static const double INNER[] = {0, 1, -1, 0}, ALL[] = {1, -1, -1, 1};
    lanes at[N_STATES], end[N_STATES], rate[N_STATES], inner[N_STATES], all[N_STATES];
    for (int i = 0; i < N_STATES; i++) {
        at[i] = end[i] = g->x[i];
        inner[i] = all[i] = g->x[i] * 0;
    }
    for (int stage = 0; stage < 4; stage++) {
        kernel_derivatives(at, g->u, g->p, rate);
        for (int i = 0; i < N_STATES; i++) {
            end[i] += (WEIGHT[stage] * size) * rate[i];
            inner[i] += INNER[stage] * rate[i];
            all[i] += ALL[stage] * rate[i];
        }
        if (stage < 3)
            for (int i = 0; i < N_STATES; i++)
                at[i] = g->x[i] + (NEXT[stage] * size) * rate[i];
    }
    for (int i = 0; i < N_STATES; i++) {
        lanes largest = larger(magnitude(inner[i]), magnitude(all[i]));
        g->difference = larger(g->difference, size * largest * reciprocal(1 + magnitude(g->x[i])));
        g->x[i] = end[i];
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
        failed += ran[lane] != g->running[lane];
    return failed;
}

static void write_signals(const group *g, double *signals)
{
    lanes y[N_SIGNALS];
    kernel_signals(g->x, g->p, y);
    write_rows(signals + g->first, N_SIGNALS, y, g->of->stride);
}

/* Repeats the steps that are waiting, and keeps the errors that are larger. */
static void repeat(repeated *r, double size, int64_t substeps)
{
    const batch *of = r->g.of;
    for (int64_t k = 0; k < 2 * substeps; k++)
        substep(&r->g, size / 2);
    lanes error = r->g.x[0] * 0;
    mask is_known = error == 0;
    for (int i = 0; i < N_STATES; i++) {
        lanes each = magnitude(r->end[i] - r->g.x[i]) / (1 + magnitude(r->end[i]));
        is_known &= each == each;
        error = larger(error, each);
    }
    for (int k = 0; k < r->waiting; k++) {
        double found = is_known[k] ? error[k] : __builtin_inf(), *kept = &of->error[r->member[k]];
        if (found > *kept)
            *kept = found;
    }
    r->waiting = 0;
}

/* Whether a running member's step may have its largest error so far, and is among those that it may repeat. */
static int is_watched(const batch *of, int64_t member, double difference)
{
    double *largest = &of->difference[member], *allowed = &of->allowed[member];
    int is_first = *largest == 0;
    *allowed = __builtin_fmin(*allowed + REPEATED_SHARE, REPEATED_FIRST);
    if ((difference <= SMALLEST_DIFFERENCE && !is_first) || ERROR_OF_DIFFERENCE * difference <= of->error[member])
        return 0;
    if (difference <= RECORD * *largest && (*allowed < 1 || difference * *allowed <= *largest))
        return 0;
    *allowed = __builtin_fmax(*allowed - 1, 0);
    if (difference > *largest)
        *largest = difference;
    return 1;
}

/* Collects the steps of a group that are repeated; `start` are their states before. */
static void watch(const group *g, const lanes start[], repeated *r, double size, int64_t substeps)
{
    for (int lane = 0; lane < WIDTH; lane++) {
        if (!g->running[lane] || !is_watched(g->of, g->first + lane, g->difference[lane]))
            continue;
        int k = r->waiting++;
        r->member[k] = g->first + lane;
        for (int i = 0; i < N_STATES; i++) {
            r->g.x[i][k] = start[i][lane];
            r->end[i][k] = g->x[i][lane];
        }
        for (int i = 0; i < N_INPUTS; i++)
            r->g.u[i][k] = g->u[i][lane];
        for (int i = 0; i < N_PARAMETERS; i++)
            r->p[i][k] = g->p[i][lane];
        if (r->waiting == WIDTH)
            repeat(r, size, substeps);
    }
}

int64_t lanes_step(const batch *of, double size, int64_t substeps, int64_t plain, double *signals)
{
    int64_t failed = 0;
    repeated r = {0};
    r.g.of = of;
    r.g.p = r.p;
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        lanes start[N_STATES];
        read_group(&g, of, block, N_PARAMETERS);
        read_inputs(&g);
        for (int i = 0; i < N_STATES; i++)
            start[i] = g.x[i];
        mask ran = g.running;
        for (int64_t k = 1; k <= substeps && any(g.running); k++) {
            substep(&g, size);
            if (!plain)
                check(&g, k);
        }
        if (any(ran))
            failed += settle(&g, ran);
        if (!plain && any(g.running))
            watch(&g, start, &r, size, substeps);
        if (signals)
            write_signals(&g, signals);
    }
    if (r.waiting)
        repeat(&r, size, substeps);
    return failed;
}

int64_t lanes_check(const batch *of)
{
    int64_t failed = 0;
    for (int64_t block = 0; block < of->blocks; block++) {
        group g;
        read_group(&g, of, block, N_GEOMETRY);
        mask ran = g.running;
        check(&g, 0);
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
