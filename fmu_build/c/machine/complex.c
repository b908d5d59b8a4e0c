#include "complex.h"

#include <float.h>

/* Scales rows and columns by powers of two to about equal norms (Osborne 1960), without rounding. */
static void balance(int64_t n, double *a)
{
    for (int round = 0, changed = 1; changed && round < 40; round++) {
        changed = 0;
        for (int64_t i = 0; i < n; i++) {
            double row = 0, column = 0, factor = 1;
            for (int64_t j = 0; j < n; j++) {
                row += j == i ? 0 : fabs(a[i * n + j]);
                column += j == i ? 0 : fabs(a[j * n + i]);
            }
            if (!(row > 0 && column > 0))
                continue;
            while (column * factor * 2 < row / factor)
                factor *= 2;
            while (column * factor > 2 * row / factor)
                factor /= 2;
            if (factor == 1)
                continue;
            changed = 1;
            for (int64_t j = 0; j < n; j++) {
                a[i * n + j] /= factor;
                a[j * n + i] *= factor;
            }
        }
    }
}

/* To Hessenberg form by elimination with pivots: a similar matrix with zeros below its first subdiagonal. */
static void reduce(int64_t n, double *a)
{
    for (int64_t k = 1; k < n - 1; k++) {
        int64_t pivot = k;
        for (int64_t i = k; i < n; i++)
            if (fabs(a[i * n + k - 1]) > fabs(a[pivot * n + k - 1]))
                pivot = i;
        if (a[pivot * n + k - 1] == 0)
            continue;
        for (int64_t j = 0; pivot != k && j < n; j++) {
            double kept = a[pivot * n + j];
            a[pivot * n + j] = a[k * n + j];
            a[k * n + j] = kept;
        }
        for (int64_t i = 0; pivot != k && i < n; i++) {
            double kept = a[i * n + pivot];
            a[i * n + pivot] = a[i * n + k];
            a[i * n + k] = kept;
        }
        for (int64_t i = k + 1; i < n; i++) {
            double factor = a[i * n + k - 1] / a[k * n + k - 1];
            if (factor == 0)
                continue;
            for (int64_t j = k - 1; j < n; j++)
                a[i * n + j] -= factor * a[k * n + j];
            for (int64_t j = 0; j < n; j++)
                a[j * n + k] += factor * a[j * n + i];
        }
    }
}

static cplx root(cplx z)
{
    double r = size_of(z), re = sqrt((r + fabs(z.re)) / 2);
    if (re == 0)
        return cx(0, 0);
    double im = z.im / (2 * re);
    return z.re >= 0 ? cx(re, im) : cx(fabs(im), z.im < 0 ? -re : re);
}

/* The eigenvalue of the last 2x2 block of rows 0 to m that is nearer to its last element (Wilkinson). */
static cplx shift_of(int64_t n, int64_t m, const cplx *h)
{
    cplx a = h[(m - 1) * n + m - 1], b = h[(m - 1) * n + m], c = h[m * n + m - 1], d = h[m * n + m];
    cplx half = cx((a.re - d.re) / 2, (a.im - d.im) / 2), bc = product(b, c);
    cplx r = root(plus(product(half, half), bc));
    cplx one = plus(half, r), other = minus(half, r), larger = size_of(one) > size_of(other) ? one : other;
    return size_of(larger) > 0 ? minus(d, quotient(bc, larger)) : d;
}

/* A step of QR with shift on rows `low` to `m`, by rotations of neighbouring rows, then columns. */
static void turn(int64_t n, int64_t low, int64_t m, cplx *h, cplx shift)
{
    cplx cosine[2] = {{0, 0}, {0, 0}}, sine[2] = {{0, 0}, {0, 0}};
    for (int64_t i = low; i <= m; i++)
        h[i * n + i] = minus(h[i * n + i], shift);
    for (int64_t k = low; k <= m; k++) {
        if (k < m) {
            cplx x = h[k * n + k], y = h[(k + 1) * n + k];
            double r = hypot(size_of(x), size_of(y));
            cosine[k & 1] = r > 0 ? cx(x.re / r, x.im / r) : cx(1, 0);
            sine[k & 1] = r > 0 ? cx(y.re / r, y.im / r) : cx(0, 0);
            cplx c = cosine[k & 1], s = sine[k & 1];
            for (int64_t j = k; j <= m; j++) {
                cplx p = h[k * n + j], q = h[(k + 1) * n + j];
                h[k * n + j] = plus(product(conjugate(c), p), product(conjugate(s), q));
                h[(k + 1) * n + j] = minus(product(c, q), product(s, p));
            }
        }
        if (k > low) { /* the rotation before this one, on columns, once no row needs them */
            cplx c = cosine[(k - 1) & 1], s = sine[(k - 1) & 1];
            for (int64_t i = low; i <= k; i++) {
                cplx p = h[i * n + k - 1], q = h[i * n + k];
                h[i * n + k - 1] = plus(product(p, c), product(q, s));
                h[i * n + k] = minus(product(q, conjugate(c)), product(p, conjugate(s)));
            }
        }
    }
    for (int64_t i = low; i <= m; i++)
        h[i * n + i] = plus(h[i * n + i], shift);
}

int eigenvalues(int64_t n, double *matrix, cplx *h, cplx *values)
{
    balance(n, matrix);
    reduce(n, matrix);
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++)
            h[i * n + j] = cx(j + 1 >= i ? matrix[i * n + j] : 0, 0);
    for (int64_t m = n - 1, tries = 0; m >= 0;) {
        int64_t low = m;
        while (low > 0) {
            double near = size_of(h[low * n + low]) + size_of(h[(low - 1) * n + low - 1]);
            if (size_of(h[low * n + low - 1]) <= DBL_EPSILON * (near > 0 ? near : 1))
                break;
            low--;
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
        turn(n, low, m, h, tries % 12 ? shift_of(n, m, h) : plus(h[m * n + m], h[m * n + m - 1]));
    }
    return 0;
}

void solve(int64_t n, int64_t m, cplx *M, cplx *R)
{
    for (int64_t k = 0; k < n; k++) {
        int64_t pivot = k;
        for (int64_t i = k + 1; i < n; i++)
            if (size_of(M[i * n + k]) > size_of(M[pivot * n + k]))
                pivot = i;
        for (int64_t j = k; pivot != k && j < n; j++) {
            cplx kept = M[pivot * n + j];
            M[pivot * n + j] = M[k * n + j];
            M[k * n + j] = kept;
        }
        for (int64_t j = 0; pivot != k && j < m; j++) {
            cplx kept = R[pivot * m + j];
            R[pivot * m + j] = R[k * m + j];
            R[k * m + j] = kept;
        }
        for (int64_t i = k + 1; i < n; i++) {
            if (M[i * n + k].re == 0 && M[i * n + k].im == 0)
                continue;
            cplx factor = quotient(M[i * n + k], M[k * n + k]);
            for (int64_t j = k + 1; j < n; j++)
                M[i * n + j] = minus(M[i * n + j], product(factor, M[k * n + j]));
            for (int64_t j = 0; j < m; j++)
                R[i * m + j] = minus(R[i * m + j], product(factor, R[k * m + j]));
        }
    }
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = 0; j < m; j++) {
            cplx sum = R[k * m + j];
            for (int64_t i = k + 1; i < n; i++)
                sum = minus(sum, product(M[k * n + i], R[i * m + j]));
            R[k * m + j] = quotient(sum, M[k * n + k]);
        }
}

/* (tr P^q)^(1/q) tends to the largest eigenvalue of P = M* M; with q = 2^20 it is too large by at most ln(6)/q. */
double largest_singular_value(int64_t n, const cplx *M)
{
    cplx P[36], next[36];
    double exponent = 0, power = 1;
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) {
            P[i * n + j] = cx(0, 0);
            for (int64_t k = 0; k < n; k++)
                P[i * n + j] = plus(P[i * n + j], product(conjugate(M[k * n + i]), M[k * n + j]));
        }
    for (int round = 0;; round++) {
        double trace = 0;
        for (int64_t i = 0; i < n; i++)
            trace += P[i * n + i].re;
        if (!(trace > 0))
            return trace == 0 ? 0 : NAN;
        exponent += log(trace) / power;
        if (round == 20)
            break;
        for (int64_t i = 0; i < n * n; i++)
            P[i] = cx(P[i].re / trace, P[i].im / trace);
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = i; j < n; j++) {
                cplx sum = cx(0, 0);
                for (int64_t k = 0; k < n; k++)
                    sum = plus(sum, product(P[i * n + k], P[k * n + j]));
                next[i * n + j] = sum;
                next[j * n + i] = conjugate(sum);
            }
        for (int64_t i = 0; i < n * n; i++)
            P[i] = next[i];
        power *= 2;
    }
    return exp(exponent / 2);
}
