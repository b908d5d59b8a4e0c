#include <float.h>

#include "complex.h"
#include "turning.h"

#define PI 3.141592653589793
enum { POINTS = 300, MOST_POINTS = 900, MOST_SIGNALS = N_LEGS * 4, ABOUT = 13 };
/* as harness/control/margins.py: what counts as converged to the real axis, and factors beyond which there is no limit */
#define FLAT 0.02
#define BOUNDLESS 1e6

/* The controller F = -(D + C (z - A)^-1 B) y, from the law's entries and the maps of its space. */
typedef struct {
    int64_t n, m; /* states, signals */
    double *A, *B, *C, *D;
} feedback;

typedef struct {
    const turning *t;
    feedback law;
    int64_t delay;
    cplx *resolvent, *right; /* for the larger of plant and law */
} system_of;

static void clear(double *values, int64_t n)
{
    for (int64_t i = 0; i < n; i++)
        values[i] = 0;
}

/* What a measurement puts into the law: of errors y enters with its sign, of readings with the other. */
static void read_law(const turning *t, const loop *w, feedback *f)
{
    int64_t n = f->n, m = f->m;
    double sign = w->kinds == 1 ? 1 : -1;
    int64_t first = n + (w->kinds == 1 ? 0 : w->size);
    clear(f->A, n * n + n * m + N_LEGS * n + N_LEGS * m);
    for (int64_t k = 0; k < w->entries; k++) {
        int64_t row = w->entry_row[k], column = w->entry_column[k], signal = column - first;
        double value = w->values.at[k * w->values.element];
        if (column < n) {
            if (row >= N_LEGS)
                f->A[(row - N_LEGS) * n + column] = value;
            for (int i = 0; row < N_LEGS && i < N_LEGS; i++)
                f->C[i * n + column] += t->to_force[i * N_LEGS + row] * value;
        } else if (signal >= 0 && signal < m)
            for (int64_t j = 0; j < m; j++) {
                double part = sign * value * t->to_space[signal * m + j];
                if (row >= N_LEGS)
                    f->B[(row - N_LEGS) * m + j] += part;
                for (int i = 0; row < N_LEGS && i < N_LEGS; i++)
                    f->D[i * m + j] += t->to_force[i * N_LEGS + row] * part;
            }
    }
}

/* x+ = M x of the closed loop: plant, forces under way, law. */
static void close_loop(const system_of *s, int64_t n, double *M)
{
    const turning *t = s->t;
    const feedback *f = &s->law;
    int64_t np = t->n_plant, under_way = N_LEGS * s->delay, law = np + under_way;
    clear(M, n * n);
    for (int64_t i = 0; i < np; i++) {
        for (int64_t j = 0; j < np; j++)
            M[i * n + j] = t->A[i * np + j];
        for (int64_t k = 0; k < N_LEGS && s->delay; k++)
            M[i * n + law - N_LEGS + k] = t->B[i * N_LEGS + k];
    }
    for (int64_t k = N_LEGS; k < under_way; k++)
        M[(np + k) * n + np + k - N_LEGS] = 1;
    /* the force, F = -(C x + D y), goes to the plant or to the first of those under way */
    for (int64_t k = 0; k < N_LEGS; k++)
        for (int64_t j = 0; j < n; j++) {
            double force = 0;
            if (j < np)
                for (int64_t q = 0; q < f->m; q++)
                    force -= f->D[k * f->m + q] * t->C[q * np + j];
            else if (j >= law)
                force = -f->C[k * f->n + j - law];
            if (s->delay)
                M[(np + k) * n + j] += force;
            for (int64_t i = 0; i < np && !s->delay; i++)
                M[i * n + j] += t->B[i * N_LEGS + k] * force;
        }
    for (int64_t i = 0; i < f->n; i++) {
        for (int64_t j = 0; j < np; j++)
            for (int64_t q = 0; q < f->m; q++)
                M[(law + i) * n + j] += f->B[i * f->m + q] * t->C[q * np + j];
        for (int64_t j = 0; j < f->n; j++)
            M[(law + i) * n + law + j] = f->A[i * f->n + j];
    }
}

/* (z - A)^-1 B, into `right` (n, m) */
static void resolve(const system_of *s, cplx z, int64_t n, int64_t m, const double *A, const double *B)
{
    for (int64_t i = 0; i < n * n; i++)
        s->resolvent[i] = cx(-A[i], 0);
    for (int64_t i = 0; i < n; i++)
        s->resolvent[i * n + i] = plus(s->resolvent[i * n + i], z);
    for (int64_t i = 0; i < n * m; i++)
        s->right[i] = cx(B[i], 0);
    solve(n, m, s->resolvent, s->right);
}

/* L (6, 6) at a frequency [rad/s]. */
static void loop_at(const system_of *s, double omega, cplx L[])
{
    const turning *t = s->t;
    const feedback *f = &s->law;
    double angle = omega * t->sample_time, late = angle * (double)s->delay;
    cplx z = cx(cos(angle), sin(angle)), lag = cx(cos(late), -sin(late));
    cplx P[MOST_SIGNALS * N_LEGS], K[N_LEGS * MOST_SIGNALS];
    int64_t np = t->n_plant, m = f->m;
    resolve(s, z, np, N_LEGS, t->A, t->B);
    for (int64_t q = 0; q < m; q++)
        for (int64_t k = 0; k < N_LEGS; k++) {
            cplx sum = cx(0, 0);
            for (int64_t i = 0; i < np; i++) {
                cplx x = s->right[i * N_LEGS + k];
                sum = plus(sum, cx(t->C[q * np + i] * x.re, t->C[q * np + i] * x.im));
            }
            P[q * N_LEGS + k] = sum;
        }
    if (f->n)
        resolve(s, z, f->n, m, f->A, f->B);
    for (int64_t i = 0; i < N_LEGS; i++)
        for (int64_t q = 0; q < m; q++) {
            cplx sum = cx(f->D[i * m + q], 0);
            for (int64_t j = 0; j < f->n; j++) {
                cplx x = s->right[j * m + q];
                sum = plus(sum, cx(f->C[i * f->n + j] * x.re, f->C[i * f->n + j] * x.im));
            }
            K[i * m + q] = sum;
        }
    for (int64_t i = 0; i < N_LEGS; i++)
        for (int64_t k = 0; k < N_LEGS; k++) {
            cplx sum = cx(0, 0);
            for (int64_t q = 0; q < m; q++)
                sum = plus(sum, product(K[i * m + q], P[q * N_LEGS + k]));
            L[i * N_LEGS + k] = product(sum, lag);
        }
}

/* The loop cut at one leg, the others closed: L_kk - L_ko (1 + L_oo)^-1 L_ok. */
static cplx one_leg(const cplx L[], int leg)
{
    enum { OTHERS = N_LEGS - 1 };
    cplx M[OTHERS * OTHERS], x[OTHERS], found = L[leg * N_LEGS + leg];
    for (int i = 0; i < OTHERS; i++) {
        int row = i + (i >= leg);
        x[i] = L[row * N_LEGS + leg];
        for (int j = 0; j < OTHERS; j++)
            M[i * OTHERS + j] = plus(L[row * N_LEGS + j + (j >= leg)], cx(i == j, 0));
    }
    solve(OTHERS, 1, M, x);
    for (int i = 0; i < OTHERS; i++)
        found = minus(found, product(L[leg * N_LEGS + i + (i >= leg)], x[i]));
    return found;
}

static cplx leg_at(const system_of *s, double omega, int leg)
{
    cplx L[N_LEGS * N_LEGS];
    loop_at(s, omega, L);
    return one_leg(L, leg);
}

/* sigma(S) or sigma(T) of L. */
static double size_of_answer(const cplx L[], int of_t)
{
    cplx M[N_LEGS * N_LEGS], S[N_LEGS * N_LEGS];
    for (int i = 0; i < N_LEGS * N_LEGS; i++) {
        S[i] = cx(i % (N_LEGS + 1) == 0, 0);
        M[i] = plus(S[i], L[i]);
    }
    solve(N_LEGS, N_LEGS, M, S);
    for (int i = 0; of_t && i < N_LEGS * N_LEGS; i++)
        S[i] = minus(cx(i % (N_LEGS + 1) == 0, 0), S[i]);
    return largest_singular_value(N_LEGS, S);
}

/* What changes its sign: the imaginary part, or the logarithm of the size. */
static double crossing(cplx z, int by_size)
{
    return by_size ? log(size_of(z)) : z.im;
}

/* Where a leg's response crosses between two frequencies, by false position that halves a value that stays (Illinois). */
static double crossing_between(const system_of *s, int leg, int by_size, double a, double fa, double b, double fb)
{
    for (int k = 0; k < 60 && b - a > 1e-12 * b; k++) {
        double at = b - fb * (b - a) / (fb - fa);
        if (!(at > a && at < b))
            at = (a + b) / 2;
        double f = crossing(leg_at(s, at, leg), by_size);
        if (f == 0)
            return at;
        if ((f > 0) == (fb > 0)) {
            b = at;
            fb = f;
            fa /= 2;
        } else {
            a = at;
            fa = f;
            fb /= 2;
        }
    }
    return (a + b) / 2;
}

static void take_gain(double margins[], cplx z)
{
    double gain = 1 / fabs(z.re);
    if (!(z.re < 0) || !(fabs(z.im) < FLAT * fabs(z.re)) || !(gain > 1 / BOUNDLESS && gain < BOUNDLESS))
        return;
    if (gain > 1 && gain < margins[0])
        margins[0] = gain;
    if (gain < 1 && gain > margins[1])
        margins[1] = gain;
}

/* The responses of a leg near 0 and at the highest frequency, where they have converged to the real axis. */
static void take_ends(const system_of *s, int leg, const double omega[], int64_t n, double margins[])
{
    double near[] = {omega[0], omega[n - 1]}, far[] = {omega[0] / 10, omega[n - 1]};
    for (int k = 0; k < 2; k++) {
        cplx z = leg_at(s, near[k], leg), beyond = leg_at(s, far[k], leg);
        if (size_of(minus(beyond, z)) <= FLAT * size_of(z) && fabs(z.im) < FLAT * size_of(z))
            take_gain(margins, beyond);
    }
}

static void leg_margins(const system_of *s, int leg, const double omega[], const cplx at[], int64_t n, double margins[])
{
    margins[0] = margins[2] = margins[3] = INFINITY;
    margins[1] = 0;
    margins[4] = NAN;
    for (int64_t k = 0; k + 1 < n; k++)
        for (int by_size = 0; by_size < 2; by_size++) {
            double a = crossing(at[k], by_size), b = crossing(at[k + 1], by_size);
            if ((a > 0) == (b > 0) || !(a == a && b == b))
                continue;
            double w = crossing_between(s, leg, by_size, omega[k], a, omega[k + 1], b);
            cplx z = leg_at(s, w, leg);
            if (!by_size) {
                take_gain(margins, z);
                continue;
            }
            /* delay only adds lag: a lead is a lag of 2 pi less it */
            double lag = atan2(-z.im, -z.re);
            lag = lag < 0 ? lag + 2 * PI : lag;
            margins[2] = fmin(margins[2], fmin(lag, 2 * PI - lag));
            margins[3] = fmin(margins[3], lag / w);
            margins[4] = margins[4] > w / (2 * PI) ? margins[4] : w / (2 * PI);
        }
    take_ends(s, leg, omega, n, margins);
}

/* The largest value between the neighbours of the largest on the grid, by golden sections. */
static double peak(const system_of *s, int of_t, const double omega[], const double values[], int64_t n)
{
    int64_t best = 0;
    for (int64_t k = 1; k < n; k++)
        best = values[k] > values[best] ? k : best;
    double a = log(omega[best > 0 ? best - 1 : 0]), b = log(omega[best + 1 < n ? best + 1 : n - 1]), most = values[best];
    for (int k = 0; k < 40; k++) {
        cplx L[N_LEGS * N_LEGS];
        double x = b - 0.6180339887498949 * (b - a), y = a + 0.6180339887498949 * (b - a);
        loop_at(s, exp(x), L);
        double f = size_of_answer(L, of_t);
        loop_at(s, exp(y), L);
        double g = size_of_answer(L, of_t);
        most = fmax(most, fmax(f, g));
        if (f > g)
            b = y;
        else
            a = x;
    }
    return most;
}

static void insert(double omega[], int64_t *n, double value)
{
    int64_t k = *n;
    if (k >= MOST_POINTS)
        return;
    for (; k > 0 && omega[k - 1] > value; k--)
        omega[k] = omega[k - 1];
    omega[k] = value;
    (*n)++;
}

/* From a thousandth of the slowest pole to half the sample rate, and dense about poles that are lightly damped. */
static int64_t grid(const system_of *s, const cplx poles[], int64_t n_poles, double omega[])
{
    double h = s->t->sample_time, top = PI / h, slowest = INFINITY;
    int64_t n = 0;
    for (int64_t k = 0; k < n_poles; k++) {
        double size = size_of(poles[k]), rate = size > 1e-9 ? hypot(log(size), atan2(poles[k].im, poles[k].re)) / h : 0;
        slowest = rate > 1e-6 && rate < slowest ? rate : slowest;
    }
    double low = fmin(slowest / 1000, top / 10);
    top *= 1 - 1e-9;
    for (int k = 0; k < POINTS; k++)
        omega[n++] = low * exp(log(top / low) * k / (POINTS - 1));
    for (int64_t k = 0; k < n_poles; k++) {
        double size = size_of(poles[k]);
        if (!(size > 1e-9) || !(poles[k].im > 0))
            continue;
        double re = log(size) / h, im = atan2(poles[k].im, poles[k].re) / h;
        if (fabs(re) > 0.5 * im)
            continue;
        for (int i = 0; i < ABOUT; i++) {
            double at = im + re * (0.5 * i - 3);
            if (at > low && at < top)
                insert(omega, &n, at);
        }
    }
    return n;
}

/* Frequencies and damping ratios of the poles, a pair once, the slowest first. */
static int64_t modes_of(double h, const cplx poles[], int64_t n, double modes[])
{
    int64_t found = 0;
    for (int64_t k = 0; k < n; k++) {
        double size = size_of(poles[k]);
        if (!(size > 1e-9))
            continue;
        double re = log(size) / h, im = atan2(poles[k].im, poles[k].re) / h, rate = hypot(re, im);
        if (im < -1e-9 * rate)
            continue;
        int64_t at = found++;
        for (; at > 0 && modes[2 * (at - 1)] > rate / (2 * PI); at--) {
            modes[2 * at] = modes[2 * at - 2];
            modes[2 * at + 1] = modes[2 * at - 1];
        }
        modes[2 * at] = rate / (2 * PI);
        modes[2 * at + 1] = rate > 0 ? -re / rate : 1;
    }
    return found;
}

int64_t turn_margins(turning *t, const loop *w)
{
    system_of s = {.t = t, .delay = (int64_t)w->delay.at[0]};
    feedback *f = &s.law;
    double omega[MOST_POINTS], *room = t->work, *results = t->results;
    int64_t n = t->n_plant + N_LEGS * s.delay + w->n_states, biggest = n > w->n_states ? n : w->n_states;
    if (!t->n_plant || !w->kinds || w->law || n > t->most_states || w->size > MOST_SIGNALS)
        return 1;
    f->n = w->n_states;
    f->m = w->size;
    f->A = room;
    f->B = f->A + f->n * f->n;
    f->C = f->B + f->n * f->m;
    f->D = f->C + N_LEGS * f->n;
    room = f->D + N_LEGS * f->m;
    s.resolvent = (cplx *)(void *)room;
    s.right = s.resolvent + biggest * biggest;
    cplx *poles = s.right + biggest * (f->m > N_LEGS ? f->m : N_LEGS), *legs = poles + n;
    double *values = (double *)(void *)(legs + N_LEGS * MOST_POINTS), *M = values + 2 * MOST_POINTS;
    if (M + n * n > t->work + t->n_work)
        return 1;
    read_law(t, w, f);
    close_loop(&s, n, M);
    if (eigenvalues(n, M, s.resolvent, poles))
        return 1;
    double *modes = results + POLES + 2 * t->most_states;
    results[RADIUS] = 0;
    results[N_POLES] = (double)n;
    for (int64_t k = 0; k < n; k++) {
        results[RADIUS] = fmax(results[RADIUS], size_of(poles[k]));
        results[POLES + 2 * k] = poles[k].re;
        results[POLES + 2 * k + 1] = poles[k].im;
    }
    results[N_MODES] = (double)modes_of(t->sample_time, poles, n, modes);
    for (int k = PEAK_S; k < N_MODES; k++)
        results[k] = NAN;
    if (!(results[RADIUS] < 1))
        return 0;
    int64_t points = grid(&s, poles, n, omega);
    for (int64_t k = 0; k < points; k++) {
        cplx L[N_LEGS * N_LEGS];
        loop_at(&s, omega[k], L);
        for (int leg = 0; leg < N_LEGS; leg++)
            legs[leg * MOST_POINTS + k] = one_leg(L, leg);
        values[k] = size_of_answer(L, 0);
        values[MOST_POINTS + k] = size_of_answer(L, 1);
    }
    for (int leg = 0; leg < N_LEGS; leg++)
        leg_margins(&s, leg, omega, legs + leg * MOST_POINTS, points, results + LEG_MARGINS + 5 * leg);
    results[PEAK_S] = peak(&s, 0, omega, values, points);
    results[PEAK_T] = peak(&s, 1, omega, values + MOST_POINTS, points);
    return 0;
}
