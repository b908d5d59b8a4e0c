/* Poles, modes and margins of the linear loop, as harness/control/loop_margins.py has them, with small dense matrices of
   complex numbers, by rows. */
#include <complex.h>
#include <float.h>
#include <math.h>

#define WITH_C_LIBRARY
#include "turning.h"

/* products and quotients need not look for infinite parts */
#pragma STDC CX_LIMITED_RANGE ON

#define PI 3.141592653589793
enum { POINTS = 300, MOST_POINTS = 900, ABOUT = 13 };
/* what counts as converged to the real axis, and factors beyond which there is no limit */
#define FLAT 0.02
#define BOUNDLESS 1e6

/* ---- matrices -------------------------------------------------------------------------------------------------- */

/* Scales the states of (A, B, C) by powers of two so that A has rows and columns of about equal norms (Osborne 1960). */
static void balance(int64_t n, int64_t m, double complex *A, double complex *B, double complex *C)
{
    for (int round = 0, changed = 1; changed && round < 40; round++) {
        changed = 0;
        for (int64_t i = 0; i < n; i++) {
            double row = 0, column = 0, factor = 1;
            for (int64_t j = 0; j < n; j++) {
                row += j == i ? 0 : cabs(A[i * n + j]);
                column += j == i ? 0 : cabs(A[j * n + i]);
            }
            while (row > 0 && column > 0 && column * factor * 2 < row / factor)
                factor *= 2;
            while (row > 0 && column > 0 && column * factor > 2 * row / factor)
                factor /= 2;
            for (int64_t j = 0; j < n; j++) {
                A[i * n + j] /= factor;
                A[j * n + i] *= factor;
            }
            for (int64_t j = 0; j < m; j++) {
                B[i * m + j] /= factor;
                C[j * n + i] *= factor;
            }
            changed |= factor != 1;
        }
    }
}

typedef struct { double complex c, s; } rotation;

/* The rotation of two numbers that makes the second one 0. */
static rotation rotation_of(double complex x, double complex y)
{
    double r = hypot(cabs(x), cabs(y));
    return r > 0 ? (rotation){x / r, y / r} : (rotation){1, 0};
}

static rotation inverse(rotation by) { return (rotation){conj(by.c), conj(by.s)}; }

/* Rotates n pairs of elements, from one to the next `apart` places. */
static void rotate(int64_t n, int64_t apart, double complex *one, double complex *other, rotation by)
{
    for (int64_t k = 0; k < n * apart; k += apart) {
        double complex p = one[k], q = other[k];
        one[k] = conj(by.c) * p + conj(by.s) * q;
        other[k] = by.c * q - by.s * p;
    }
}

/* Transforms the states of (A, B, C), by rotations, so that A is a Hessenberg matrix. */
static void reduce(int64_t n, int64_t m, double complex *A, double complex *B, double complex *C)
{
    for (int64_t k = 1; k < n - 1; k++)
        for (int64_t i = k + 1; i < n; i++) {
            if (A[i * n + k - 1] == 0)
                continue;
            rotation by = rotation_of(A[k * n + k - 1], A[i * n + k - 1]);
            rotate(n, 1, A + k * n, A + i * n, by);
            rotate(n, n, A + k, A + i, inverse(by));
            rotate(m, 1, B + k * m, B + i * m, by);
            rotate(m, n, C + k, C + i, inverse(by));
            A[i * n + k - 1] = 0;
        }
}

/* The eigenvalue of the last 2x2 block of rows 0 to m that is nearer to its last element (Wilkinson). */
static double complex shift_of(int64_t n, int64_t m, const double complex *h)
{
    double complex a = h[(m - 1) * n + m - 1], d = h[m * n + m], bc = h[(m - 1) * n + m] * h[m * n + m - 1];
    double complex half = (a - d) / 2, root = csqrt(half * half + bc), one = half + root, other = half - root;
    double complex larger = cabs(one) > cabs(other) ? one : other;
    return cabs(larger) > 0 ? d - bc / larger : d;
}

/* A step of QR with shift on rows `low` to `m`, by rotations of neighbouring rows, then columns. */
static void turn(int64_t n, int64_t low, int64_t m, double complex *h, double complex shift)
{
    rotation by = {1, 0};
    for (int64_t i = low; i <= m; i++)
        h[i * n + i] -= shift;
    for (int64_t k = low; k <= m; k++) {
        double complex *at = h + k * (n + 1);
        rotation back = inverse(by);
        if (k < m) {
            by = rotation_of(at[0], at[n]);
            rotate(m - k + 1, 1, at, at + n, by);
        }
        if (k > low) /* the rotation before this one, on columns, once no row needs them */
            rotate(k - low + 1, n, h + low * n + k - 1, h + low * n + k, back);
    }
    for (int64_t i = low; i <= m; i++)
        h[i * n + i] += shift;
}

/* Eigenvalues (n) of a Hessenberg matrix (n, n), which is overwritten. Returns 0, or 1 if they do not converge. */
static int eigenvalues(int64_t n, double complex *h, double complex *values)
{
    for (int64_t m = n - 1, tries = 1; m >= 0; tries++) {
        int64_t low = m;
        for (; low > 0; low--) {
            double near = cabs(h[low * n + low]) + cabs(h[(low - 1) * n + low - 1]);
            if (cabs(h[low * n + low - 1]) <= DBL_EPSILON * (near > 0 ? near : 1))
                break;
        }
        if (low == m) {
            values[m] = h[m * n + m];
            m--;
            tries = 0;
        } else if (tries > 100)
            return 1;
        else /* now and then another shift, for matrices that a step turns into themselves */
            turn(n, low, m, h, tries % 12 ? shift_of(n, m, h) : h[m * n + m] + h[m * n + m - 1]);
    }
    return 0;
}

/* X of M X = R, for M (n, n) and R (n, m): both are overwritten, R by X. */
static void solve(int64_t n, int64_t m, double complex *M, double complex *R)
{
    for (int64_t k = 0; k < n; k++)
        for (int64_t i = k + 1; i < n; i++) {
            if (M[i * n + k] == 0)
                continue;
            rotation by = rotation_of(M[k * n + k], M[i * n + k]);
            rotate(n - k, 1, M + k * (n + 1), M + i * n + k, by);
            rotate(m, 1, R + k * m, R + i * m, by);
        }
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = 0; j < m; j++) {
            for (int64_t i = k + 1; i < n; i++)
                R[k * m + j] -= M[k * n + i] * R[i * m + j];
            R[k * m + j] /= M[k * n + k];
        }
}

/* ---- the loop -------------------------------------------------------------------------------------------------- */

/* The closed loop without delay, from disturbing forces w to those that act, w - C x, with x+ = A x + B w: states of the
   plant, then of the law; and the samples by which forces are late. */
typedef struct {
    double sample_time;
    int64_t n, delay;
    double complex *A, *B, *C;         /* (n, n), (n, 6), (6, n) */
    double complex *resolvent, *right; /* room for z - A and for B */
} closed_loop;

/* Also the states' matrix with the delay (m, m), at whose end are the forces under way, the latest first. Of errors the
   measurements enter the law with their sign, of readings with the other. */
static void close_loop(closed_loop *s, const turning *t, const loop *l, int64_t m, double complex *late)
{
    int64_t n = s->n, np = t->n_plant, readings = l->n_states + (l->kinds == 1 ? 0 : l->size);
    double sign = l->kinds == 1 ? 1 : -1;
    memset(s->A, 0, (size_t)(n * (n + 2 * N_LEGS)) * sizeof *s->A); /* B and C follow */
    memset(late, 0, (size_t)(m * m) * sizeof *late);
    for (int64_t i = 0; i < np * np; i++)
        s->A[i / np * n + i % np] = t->A[i];
    for (int64_t i = 0; i < np * N_LEGS; i++)
        s->B[i] = t->B[i];
    for (int64_t k = 0; k < l->entries; k++) {
        int64_t row = l->entry_row[k], column = l->entry_column[k], signal = column - readings;
        double value = l->values.at[k];
        for (int64_t j = 0; j < n; j++) {
            double part = j == np + column ? value : 0; /* of x_j in the law's output or next state */
            if (j < np && signal >= 0 && signal < l->size)
                part = sign * value * t->C[signal * np + j];
            if (row >= N_LEGS)
                s->A[(np + row - N_LEGS) * n + j] += part;
            for (int64_t i = 0; row < N_LEGS && i < N_LEGS; i++)
                s->C[i * n + j] += t->to_force[i * N_LEGS + row] * part;
        }
    }
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) {
            double complex open = s->A[i * n + j];
            for (int64_t k = 0; k < N_LEGS; k++)
                s->A[i * n + j] -= s->B[i * N_LEGS + k] * s->C[k * n + j];
            late[i * m + j] = m > n ? open : s->A[i * n + j];
        }
    for (int64_t k = 0; m > n && k < N_LEGS; k++)
        for (int64_t i = 0; i < n; i++) {
            late[i * m + m - N_LEGS + k] = s->B[i * N_LEGS + k];
            late[(n + k) * m + i] = -s->C[k * n + i];
        }
    for (int64_t i = n + N_LEGS; i < m; i++)
        late[i * m + i - N_LEGS] = 1;
    balance(n, N_LEGS, s->A, s->B, s->C);
    reduce(n, N_LEGS, s->A, s->B, s->C);
}

/* S (6, 6) at a frequency [rad/s]: (S0 + z^-delay (1 - S0))^-1 S0 with that of no delay, S0 = 1 - C (z - A)^-1 B. */
static void sensitivity_at(const closed_loop *s, double omega, double complex S[])
{
    int64_t n = s->n;
    double complex z = cexp(I * omega * s->sample_time), lag = cexp(-I * omega * s->sample_time * (double)s->delay);
    double complex M[N_LEGS * N_LEGS];
    for (int64_t i = 0; i < n * n; i++)
        s->resolvent[i] = (i % (n + 1) == 0 ? z : 0) - s->A[i];
    memcpy(s->right, s->B, (size_t)(n * N_LEGS) * sizeof *s->B);
    solve(n, N_LEGS, s->resolvent, s->right);
    for (int64_t i = 0; i < N_LEGS; i++)
        for (int64_t k = 0; k < N_LEGS; k++) {
            double complex T = 0;
            for (int64_t j = 0; j < n; j++)
                T += s->C[i * n + j] * s->right[j * N_LEGS + k];
            S[i * N_LEGS + k] = (i == k) - T;
            M[i * N_LEGS + k] = S[i * N_LEGS + k] + lag * T;
        }
    solve(N_LEGS, N_LEGS, M, S);
}

/* The loop broken at one leg, the others closed: S_kk = 1 / (1 + L_k). */
static double complex broken_at(const double complex S[], int leg) { return 1 / S[leg * (N_LEGS + 1)] - 1; }

static double complex leg_at(const closed_loop *s, double omega, int leg)
{
    double complex S[N_LEGS * N_LEGS];
    sensitivity_at(s, omega, S);
    return broken_at(S, leg);
}

/* The largest singular value of S, or of T = 1 - S; NaN if it is not found. */
static double largest_gain(const double complex S[], int is_complementary)
{
    double complex M[N_LEGS * N_LEGS], square[N_LEGS * N_LEGS] = {0}, values[N_LEGS];
    double largest = 0;
    for (int i = 0; i < N_LEGS * N_LEGS; i++)
        M[i] = is_complementary ? (i % (N_LEGS + 1) == 0) - S[i] : S[i];
    for (int i = 0; i < N_LEGS; i++)
        for (int j = 0; j < N_LEGS; j++)
            for (int k = 0; k < N_LEGS; k++)
                square[i * N_LEGS + j] += conj(M[k * N_LEGS + i]) * M[k * N_LEGS + j];
    reduce(N_LEGS, 0, square, square, square);
    if (eigenvalues(N_LEGS, square, values))
        return NAN;
    for (int i = 0; i < N_LEGS; i++)
        largest = fmax(largest, cabs(values[i]));
    return sqrt(largest);
}

/* What changes its sign: the imaginary part, or the logarithm of the size. */
static double crossing(double complex z, int by_size) { return by_size ? log(cabs(z)) : cimag(z); }

/* Where a leg's response crosses between frequencies, by false position that halves a value that stays (Illinois). */
static double crossing_between(const closed_loop *s, int leg, int by_size, double at[2], double f[2])
{
    for (int k = 0; k < 60 && at[1] - at[0] > 1e-12 * at[1]; k++) {
        double next = at[1] - f[1] * (at[1] - at[0]) / (f[1] - f[0]);
        if (!(next > at[0] && next < at[1]))
            next = (at[0] + at[1]) / 2;
        double value = crossing(leg_at(s, next, leg), by_size);
        if (value == 0)
            return next;
        int side = (value > 0) == (f[1] > 0);
        at[side] = next;
        f[side] = value;
        f[!side] /= 2;
    }
    return (at[0] + at[1]) / 2;
}

/* Of a leg, as `results` has them: factors on its gain, phase [rad], delay [s], crossover [Hz]. */
typedef struct {
    double up, down, phase, delay, crossover;
} leg_margins;

static void take_gain(leg_margins *margins, double complex z)
{
    double gain = 1 / fabs(creal(z));
    if (!(creal(z) < 0) || !(fabs(cimag(z)) < FLAT * fabs(creal(z))) || !(gain > 1 / BOUNDLESS && gain < BOUNDLESS))
        return;
    if (gain > 1)
        margins->up = fmin(margins->up, gain);
    if (gain < 1)
        margins->down = fmax(margins->down, gain);
}

/* What a leg's response between neighbouring frequencies says of its margins. */
static void take_crossings(const closed_loop *s, int leg, const double omega[2], const double complex at[2],
                           leg_margins *margins)
{
    for (int by_size = 0; by_size < 2; by_size++) {
        double between[] = {omega[0], omega[1]}, f[] = {crossing(at[0], by_size), crossing(at[1], by_size)};
        if ((f[0] > 0) == (f[1] > 0) || isnan(f[0]) || isnan(f[1]))
            continue;
        double w = crossing_between(s, leg, by_size, between, f);
        double complex z = leg_at(s, w, leg);
        if (!by_size) {
            take_gain(margins, z);
            continue;
        }
        /* delay only adds lag: a lead is a lag of 2 pi less it */
        double lag = carg(-z);
        lag = lag < 0 ? lag + 2 * PI : lag;
        margins->phase = fmin(margins->phase, fmin(lag, 2 * PI - lag));
        margins->delay = fmin(margins->delay, lag / w);
        margins->crossover = fmax(margins->crossover, w / (2 * PI));
    }
}

/* The same of an end of the frequencies, if the response there, and far beyond, has converged to the real axis. */
static void take_end(const closed_loop *s, int leg, double near, double far, leg_margins *margins)
{
    double complex z = leg_at(s, near, leg), beyond = leg_at(s, far, leg);
    if (cabs(beyond - z) <= FLAT * cabs(z) && fabs(cimag(z)) < FLAT * cabs(z))
        take_gain(margins, beyond);
}

/* The largest gain between the neighbours of the largest on the grid, by golden sections. */
static double peak(const closed_loop *s, int is_complementary, const double omega[], const double gains[], int64_t n)
{
    int64_t best = 0;
    for (int64_t k = 1; k < n; k++)
        best = gains[k] > gains[best] ? k : best;
    double a = log(omega[best > 0 ? best - 1 : 0]), b = log(omega[best + 1 < n ? best + 1 : n - 1]), most = gains[best];
    for (int k = 0; k < 40; k++) {
        double x = b - 0.6180339887498949 * (b - a), y = a + 0.6180339887498949 * (b - a);
        double complex at_x[N_LEGS * N_LEGS], at_y[N_LEGS * N_LEGS];
        sensitivity_at(s, exp(x), at_x);
        sensitivity_at(s, exp(y), at_y);
        double f = largest_gain(at_x, is_complementary), g = largest_gain(at_y, is_complementary);
        most = fmax(most, fmax(f, g));
        if (f > g)
            b = y;
        else
            a = x;
    }
    return most;
}

/* log(z) / h of a pole [rad/s]; not a number of one at 0, which a delay has. */
static double complex rate_of(double complex pole, double h) { return cabs(pole) > 1e-9 ? clog(pole) / h : NAN; }

/* Keeps rows (n, size) sorted by their first numbers. */
static void insert(double rows[], int64_t n, int size, const double row[])
{
    int64_t k = n;
    for (; k > 0 && rows[size * (k - 1)] > row[0]; k--)
        for (int i = 0; i < size; i++)
            rows[size * k + i] = rows[size * (k - 1) + i];
    for (int i = 0; i < size; i++)
        rows[size * k + i] = row[i];
}

/* From a thousandth of the slowest pole to half the sample rate, and dense about poles that are lightly damped. */
static int64_t grid(const closed_loop *s, const double complex poles[], int64_t n_poles, double omega[])
{
    double top = PI / s->sample_time, slowest = INFINITY;
    int64_t n = 0;
    for (int64_t k = 0; k < n_poles; k++) {
        double rate = cabs(rate_of(poles[k], s->sample_time));
        slowest = rate > 1e-6 && rate < slowest ? rate : slowest;
    }
    double low = fmin(slowest / 1000, top / 10);
    top *= 1 - 1e-9;
    for (int k = 0; k < POINTS; k++)
        omega[n++] = low * exp(log(top / low) * k / (POINTS - 1));
    for (int64_t k = 0; k < n_poles; k++) {
        double complex rate = rate_of(poles[k], s->sample_time);
        if (!(cimag(poles[k]) > 0 && fabs(creal(rate)) <= 0.5 * cimag(rate)))
            continue;
        for (int i = 0; i < ABOUT; i++) {
            double at = cimag(rate) + creal(rate) * (0.5 * i - 3);
            if (at > low && at < top && n < MOST_POINTS)
                insert(omega, n++, 1, &at);
        }
    }
    return n;
}

/* Frequencies and damping ratios of the poles, a pair once, the slowest first. */
static int64_t modes_of(double h, const double complex poles[], int64_t n, double modes[])
{
    int64_t n_modes = 0;
    for (int64_t k = 0; k < n; k++) {
        double complex rate = rate_of(poles[k], h);
        double size = cabs(rate), mode[] = {size / (2 * PI), size > 0 ? -creal(rate) / size : 1};
        if (cimag(rate) >= -1e-9 * size)
            insert(modes, n_modes++, 2, mode);
    }
    return n_modes;
}

/* Margins of each leg, and peaks, of a loop with these poles (m). */
static void find_margins(const closed_loop *s, const double complex poles[], int64_t m, double results[])
{
    double omega[MOST_POINTS], gains[2][MOST_POINTS];
    double complex S[N_LEGS * N_LEGS], at[N_LEGS][2];
    leg_margins *legs = (leg_margins *)(results + LEG_MARGINS);
    int64_t points = grid(s, poles, m, omega);
    for (int64_t k = 0; k < points; k++) {
        sensitivity_at(s, omega[k], S);
        for (int leg = 0; leg < N_LEGS; leg++) {
            at[leg][0] = at[leg][1];
            at[leg][1] = broken_at(S, leg);
            if (k > 0)
                take_crossings(s, leg, omega + k - 1, at[leg], legs + leg);
            else
                legs[leg] = (leg_margins){INFINITY, 0, INFINITY, INFINITY, NAN};
        }
        for (int is_complementary = 0; is_complementary < 2; is_complementary++)
            gains[is_complementary][k] = largest_gain(S, is_complementary);
    }
    for (int leg = 0; leg < N_LEGS; leg++) {
        take_end(s, leg, omega[0], omega[0] / 10, legs + leg);
        take_end(s, leg, omega[points - 1], omega[points - 1], legs + leg);
    }
    for (int k = 0; k < 2; k++)
        results[PEAK_S + k] = peak(s, k, omega, gains[k], points);
}

int64_t turn_margins(turning *t, const loop *l)
{
    closed_loop s = {.sample_time = t->sample_time, .n = t->n_plant + l->n_states, .delay = (int64_t)l->delay.at[0]};
    int64_t n = s.n, m = n + N_LEGS * s.delay;
    double *results = t->results;
    if (!t->n_plant || !l->kinds || l->law || m > t->most_states)
        return 1;
    s.A = (double complex *)(void *)t->work;
    s.B = s.A + n * n;
    s.C = s.B + n * N_LEGS;
    s.resolvent = s.C + n * N_LEGS;
    s.right = s.resolvent + n * n;
    double complex *late = s.right + n * N_LEGS, *poles = late + m * m;
    close_loop(&s, t, l, m, late);
    balance(m, 0, late, late, late);
    reduce(m, 0, late, late, late);
    if (eigenvalues(m, late, poles))
        return 1;
    memcpy(results + POLES, poles, (size_t)m * sizeof *poles);
    results[N_POLES] = (double)m;
    results[N_MODES] = (double)modes_of(t->sample_time, poles, m, results + POLES + 2 * t->most_states);
    results[RADIUS] = 0;
    for (int64_t k = 0; k < m; k++)
        results[RADIUS] = fmax(results[RADIUS], cabs(poles[k]));
    for (int k = PEAK_S; k < N_MODES; k++)
        results[k] = NAN;
    if (results[RADIUS] < 1)
        find_margins(&s, poles, m, results);
    return 0;
}
