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
enum { POINTS = 300, MOST_POINTS = 900, MOST_SIGNALS = N_LEGS * 4, ABOUT = 13 };
/* what counts as converged to the real axis, and factors beyond which there is no limit */
#define FLAT 0.02
#define BOUNDLESS 1e6

/* ---- matrices -------------------------------------------------------------------------------------------------- */

/* |re| + |im|, for the choice of pivots and a balance */
static double rough_size(double complex z) { return fabs(creal(z)) + fabs(cimag(z)); }

/* The row with the largest element of a column, from a row on. */
static int64_t pivot_of(int64_t n, const double complex *a, int64_t from, int64_t column)
{
    int64_t pivot = from;
    for (int64_t i = from + 1; i < n; i++)
        if (rough_size(a[i * n + column]) > rough_size(a[pivot * n + column]))
            pivot = i;
    return pivot;
}

/* Exchanges n elements, each so many places from the last. */
static void swap(int64_t n, int64_t apart, double complex *one, double complex *other)
{
    for (int64_t k = 0; one != other && k < n * apart; k += apart) {
        double complex kept = one[k];
        one[k] = other[k];
        other[k] = kept;
    }
}

/* Scales rows and columns by powers of two to about equal norms (Osborne 1960), without rounding. */
static void balance(int64_t n, double complex *a)
{
    for (int round = 0, changed = 1; changed && round < 40; round++) {
        changed = 0;
        for (int64_t i = 0; i < n; i++) {
            double row = 0, column = 0, factor = 1;
            for (int64_t j = 0; j < n; j++) {
                row += j == i ? 0 : rough_size(a[i * n + j]);
                column += j == i ? 0 : rough_size(a[j * n + i]);
            }
            while (row > 0 && column > 0 && column * factor * 2 < row / factor)
                factor *= 2;
            while (row > 0 && column > 0 && column * factor > 2 * row / factor)
                factor /= 2;
            for (int64_t j = 0; factor != 1 && j < n; j++) {
                a[i * n + j] /= factor;
                a[j * n + i] *= factor;
            }
            changed |= factor != 1;
        }
    }
}

/* To Hessenberg form by elimination with pivots: a similar matrix with zeros below its first subdiagonal. */
static void reduce(int64_t n, double complex *a)
{
    for (int64_t k = 1; k < n - 1; k++) {
        int64_t pivot = pivot_of(n, a, k, k - 1);
        swap(n, 1, a + pivot * n, a + k * n);
        swap(n, n, a + pivot, a + k);
        for (int64_t i = k + 1; i < n; i++) {
            if (a[i * n + k - 1] == 0)
                continue;
            double complex factor = a[i * n + k - 1] / a[k * n + k - 1];
            a[i * n + k - 1] = 0;
            for (int64_t j = k; j < n; j++)
                a[i * n + j] -= factor * a[k * n + j];
            for (int64_t j = 0; j < n; j++)
                a[j * n + k] += factor * a[j * n + i];
        }
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
    double complex cosine[2] = {0}, sine[2] = {0};
    for (int64_t i = low; i <= m; i++)
        h[i * n + i] -= shift;
    for (int64_t k = low; k <= m; k++) {
        if (k < m) {
            double complex x = h[k * n + k], y = h[(k + 1) * n + k];
            double r = hypot(cabs(x), cabs(y));
            double complex c = cosine[k & 1] = r > 0 ? x / r : 1, s = sine[k & 1] = r > 0 ? y / r : 0;
            for (int64_t j = k; j <= m; j++) {
                double complex p = h[k * n + j], q = h[(k + 1) * n + j];
                h[k * n + j] = conj(c) * p + conj(s) * q;
                h[(k + 1) * n + j] = c * q - s * p;
            }
        }
        if (k > low) { /* the rotation before this one, on columns, once no row needs them */
            double complex c = cosine[(k - 1) & 1], s = sine[(k - 1) & 1];
            for (int64_t i = low; i <= k; i++) {
                double complex p = h[i * n + k - 1], q = h[i * n + k];
                h[i * n + k - 1] = p * c + q * s;
                h[i * n + k] = q * conj(c) - p * conj(s);
            }
        }
    }
    for (int64_t i = low; i <= m; i++)
        h[i * n + i] += shift;
}

/* Eigenvalues (n) of a matrix (n, n), which is overwritten. Returns 0, or 1 if they do not converge. */
static int eigenvalues(int64_t n, double complex *h, double complex *values)
{
    balance(n, h);
    reduce(n, h);
    for (int64_t m = n - 1, tries = 0; m >= 0;) {
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
            continue;
        }
        if (++tries > 100)
            return 1;
        /* now and then another shift, for matrices that a step turns into themselves */
        turn(n, low, m, h, tries % 12 ? shift_of(n, m, h) : h[m * n + m] + h[m * n + m - 1]);
    }
    return 0;
}

/* X of M X = R, for M (n, n) and R (n, m): both are overwritten, R by X. Partial pivoting. */
static void solve(int64_t n, int64_t m, double complex *M, double complex *R)
{
    for (int64_t k = 0; k < n; k++) {
        int64_t pivot = pivot_of(n, M, k, k);
        swap(n - k, 1, M + k * (n + 1), M + pivot * n + k);
        swap(m, 1, R + k * m, R + pivot * m);
        for (int64_t i = k + 1; i < n; i++) {
            if (M[i * n + k] == 0)
                continue;
            double complex factor = M[i * n + k] / M[k * n + k];
            for (int64_t j = k + 1; j < n; j++)
                M[i * n + j] -= factor * M[k * n + j];
            for (int64_t j = 0; j < m; j++)
                R[i * m + j] -= factor * R[k * m + j];
        }
    }
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = 0; j < m; j++) {
            for (int64_t i = k + 1; i < n; i++)
                R[k * m + j] -= M[k * n + i] * R[i * m + j];
            R[k * m + j] /= M[k * n + k];
        }
}

void rest_of_law(const loop *l, double rest[])
{
    double complex M[MOST_LAW_STATES * MOST_LAW_STATES] = {0}, x[MOST_LAW_STATES] = {0};
    int64_t n = l->n_states;
    for (int64_t i = 0; i < n; i++)
        M[i * n + i] = 1;
    for (int64_t k = 0; k < l->entries; k++) {
        int64_t state = l->entry_row[k] - N_LEGS, column = l->entry_column[k];
        double value = l->values.at[k * l->values.element];
        if (state >= 0 && column < n)
            M[state * n + column] -= value;
        else if (state >= 0)
            x[state] += value * l->memory[column];
    }
    for (int64_t i = 0; i < n; i++) /* an integrator: 1 - a is rounding */
        if (cabs(M[i * n + i]) < 1e-6) {
            M[i * n + i] = 1;
            x[i] = 0;
        }
    solve(n, 1, M, x);
    for (int64_t i = 0; i < n; i++)
        rest[i] = creal(x[i]);
}

/* ---- the loop -------------------------------------------------------------------------------------------------- */

/* The loop broken at the forces, from those that act to those of the law, F = -C x: states of the plant, then of the law;
   and a delay of some samples, with which L(z) = C (z - A)^-1 B z^-delay. */
typedef struct {
    double sample_time;
    int64_t n, delay;
    double *A, *B, *C;                 /* (n, n), (n, 6), (6, n) */
    double complex *resolvent, *right; /* room for z - A, or the closed loop, and for B */
} open_loop;

/* Plant and law in series. Of errors the measurements enter the law with their sign, of readings with the other. */
static void join(open_loop *s, const turning *t, const loop *l)
{
    int64_t n = s->n, np = t->n_plant, readings = l->n_states + (l->kinds == 1 ? 0 : l->size);
    double sign = l->kinds == 1 ? 1 : -1;
    memset(s->A, 0, (size_t)(n * (n + 2 * N_LEGS)) * sizeof *s->A); /* B and C follow */
    for (int64_t i = 0; i < np; i++) {
        for (int64_t j = 0; j < np; j++)
            s->A[i * n + j] = t->A[i * np + j];
        for (int64_t k = 0; k < N_LEGS; k++)
            s->B[i * N_LEGS + k] = t->B[i * N_LEGS + k];
    }
    for (int64_t k = 0; k < l->entries; k++) {
        int64_t row = l->entry_row[k], column = l->entry_column[k], signal = column - readings;
        double value = l->values.at[k * l->values.element];
        for (int64_t j = 0; j < n; j++) {
            double part = j == np + column ? value : 0; /* of x_j in the law's output or next state */
            for (int64_t q = 0; j < np && signal >= 0 && signal < l->size && q < l->size; q++)
                part += sign * value * t->to_space[signal * l->size + q] * t->C[q * np + j];
            if (row >= N_LEGS)
                s->A[(np + row - N_LEGS) * n + j] += part;
            for (int64_t i = 0; row < N_LEGS && i < N_LEGS; i++)
                s->C[i * n + j] += t->to_force[i * N_LEGS + row] * part;
        }
    }
}

/* x+ = M x of the closed loop (m, m): the states, then the forces under way, the latest first. */
static void close_loop(const open_loop *s, int64_t m, double complex *M)
{
    int64_t n = s->n;
    memset(M, 0, (size_t)(m * m) * sizeof *M);
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) {
            M[i * m + j] = s->A[i * n + j];
            for (int64_t k = 0; !s->delay && k < N_LEGS; k++)
                M[i * m + j] -= s->B[i * N_LEGS + k] * s->C[k * n + j];
        }
    for (int64_t k = 0; s->delay && k < N_LEGS; k++)
        for (int64_t i = 0; i < n; i++) {
            M[i * m + m - N_LEGS + k] = s->B[i * N_LEGS + k];
            M[(n + k) * m + i] = -s->C[k * n + i];
        }
    for (int64_t i = n + N_LEGS; i < m; i++)
        M[i * m + i - N_LEGS] = 1;
}

/* S = (1 + L)^-1 (6, 6) at a frequency [rad/s]. */
static void sensitivity_at(const open_loop *s, double omega, double complex S[])
{
    int64_t n = s->n;
    double complex z = cexp(I * omega * s->sample_time), lag = cexp(-I * omega * s->sample_time * (double)s->delay);
    double complex M[N_LEGS * N_LEGS];
    for (int64_t i = 0; i < n * n; i++)
        s->resolvent[i] = (i % (n + 1) == 0 ? z : 0) - s->A[i];
    for (int64_t i = 0; i < n * N_LEGS; i++)
        s->right[i] = s->B[i];
    solve(n, N_LEGS, s->resolvent, s->right);
    for (int64_t i = 0; i < N_LEGS; i++)
        for (int64_t k = 0; k < N_LEGS; k++) {
            double complex sum = 0;
            for (int64_t j = 0; j < n; j++)
                sum += s->C[i * n + j] * s->right[j * N_LEGS + k];
            S[i * N_LEGS + k] = i == k;
            M[i * N_LEGS + k] = sum * lag + S[i * N_LEGS + k];
        }
    solve(N_LEGS, N_LEGS, M, S);
}

/* The loop broken at one leg, the others closed: S_kk = 1 / (1 + L_k). */
static double complex broken_at(const double complex S[], int leg) { return 1 / S[leg * (N_LEGS + 1)] - 1; }

static double complex leg_at(const open_loop *s, double omega, int leg)
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
    if (eigenvalues(N_LEGS, square, values))
        return NAN;
    for (int i = 0; i < N_LEGS; i++)
        largest = fmax(largest, cabs(values[i]));
    return sqrt(largest);
}

/* What changes its sign: the imaginary part, or the logarithm of the size. */
static double crossing(double complex z, int by_size) { return by_size ? log(cabs(z)) : cimag(z); }

/* Where a leg's response crosses between two frequencies, by false position that halves a value that stays (Illinois). */
static double crossing_between(const open_loop *s, int leg, int by_size, double a, double fa, double b, double fb)
{
    for (int k = 0; k < 60 && b - a > 1e-12 * b; k++) {
        double at = b - fb * (b - a) / (fb - fa);
        if (!(at > a && at < b))
            at = (a + b) / 2;
        double complex z = leg_at(s, at, leg);
        double f = crossing(z, by_size);
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

static void take_gain(double margins[], double complex z)
{
    double gain = 1 / fabs(creal(z));
    if (!(creal(z) < 0) || !(fabs(cimag(z)) < FLAT * fabs(creal(z))) || !(gain > 1 / BOUNDLESS && gain < BOUNDLESS))
        return;
    if (gain > 1 && gain < margins[0])
        margins[0] = gain;
    if (gain < 1 && gain > margins[1])
        margins[1] = gain;
}

static void leg_margins(const open_loop *s, int leg, const double omega[], const double complex at[], int64_t n,
                        double margins[])
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
            double complex z = leg_at(s, w, leg);
            if (!by_size) {
                take_gain(margins, z);
                continue;
            }
            /* delay only adds lag: a lead is a lag of 2 pi less it */
            double lag = carg(-z);
            lag = lag < 0 ? lag + 2 * PI : lag;
            margins[2] = fmin(margins[2], fmin(lag, 2 * PI - lag));
            margins[3] = fmin(margins[3], lag / w);
            margins[4] = margins[4] > w / (2 * PI) ? margins[4] : w / (2 * PI);
        }
    /* near 0 and at the highest frequency, where they have converged to the real axis */
    double near[] = {omega[0], omega[n - 1]}, far[] = {omega[0] / 10, omega[n - 1]};
    for (int k = 0; k < 2; k++) {
        double complex z = leg_at(s, near[k], leg), beyond = leg_at(s, far[k], leg);
        if (cabs(beyond - z) <= FLAT * cabs(z) && fabs(cimag(z)) < FLAT * cabs(z))
            take_gain(margins, beyond);
    }
}

/* The largest value between the neighbours of the largest on the grid, by golden sections. */
static double peak(const open_loop *s, int is_complementary, const double omega[], const double values[], int64_t n)
{
    int64_t best = 0;
    for (int64_t k = 1; k < n; k++)
        best = values[k] > values[best] ? k : best;
    double a = log(omega[best > 0 ? best - 1 : 0]), b = log(omega[best + 1 < n ? best + 1 : n - 1]), most = values[best];
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
static double complex rate_of(double complex pole, double h)
{
    return cabs(pole) > 1e-9 ? clog(pole) / h : NAN;
}

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
static int64_t grid(const open_loop *s, const double complex poles[], int64_t n_poles, double omega[])
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

int64_t turn_margins(turning *t, const loop *l)
{
    open_loop s = {.sample_time = t->sample_time, .n = t->n_plant + l->n_states, .delay = (int64_t)l->delay.at[0]};
    double omega[MOST_POINTS], *results = t->results;
    int64_t n = s.n, m = n + N_LEGS * s.delay; /* states of the broken and of the closed loop */
    if (!t->n_plant || !l->kinds || l->law || m > t->most_states || l->size > MOST_SIGNALS)
        return 1;
    s.A = t->work;
    s.B = s.A + n * n;
    s.C = s.B + n * N_LEGS;
    s.resolvent = (double complex *)(void *)(s.C + n * N_LEGS);
    s.right = s.resolvent + m * m;
    double complex *poles = s.right + n * N_LEGS, *legs = poles + m;
    double *values = (double *)(void *)(legs + N_LEGS * MOST_POINTS);
    if (values + 2 * MOST_POINTS > t->work + t->n_work)
        return 1;
    join(&s, t, l);
    close_loop(&s, m, s.resolvent);
    if (eigenvalues(m, s.resolvent, poles))
        return 1;
    results[RADIUS] = 0;
    results[N_POLES] = (double)m;
    for (int64_t k = 0; k < m; k++) {
        results[RADIUS] = fmax(results[RADIUS], cabs(poles[k]));
        results[POLES + 2 * k] = creal(poles[k]);
        results[POLES + 2 * k + 1] = cimag(poles[k]);
    }
    results[N_MODES] = (double)modes_of(t->sample_time, poles, m, results + POLES + 2 * t->most_states);
    for (int k = PEAK_S; k < N_MODES; k++)
        results[k] = NAN;
    if (!(results[RADIUS] < 1))
        return 0;
    int64_t points = grid(&s, poles, m, omega);
    for (int64_t k = 0; k < points; k++) {
        double complex S[N_LEGS * N_LEGS];
        sensitivity_at(&s, omega[k], S);
        for (int leg = 0; leg < N_LEGS; leg++)
            legs[leg * MOST_POINTS + k] = broken_at(S, leg);
        for (int is_complementary = 0; is_complementary < 2; is_complementary++)
            values[is_complementary * MOST_POINTS + k] = largest_gain(S, is_complementary);
    }
    for (int leg = 0; leg < N_LEGS; leg++)
        leg_margins(&s, leg, omega, legs + leg * MOST_POINTS, points, results + LEG_MARGINS + 5 * leg);
    results[PEAK_S] = peak(&s, 0, omega, values, points);
    results[PEAK_T] = peak(&s, 1, omega, values + MOST_POINTS, points);
    return 0;
}
