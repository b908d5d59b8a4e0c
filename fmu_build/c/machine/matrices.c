#include "matrices.h"

#include <float.h>
#include <math.h>

/* |re| + |im|, for the choice of pivots and a balance */
static double rough_size(double complex z) { return fabs(creal(z)) + fabs(cimag(z)); }

static void swap(double complex *one, double complex *other)
{
    double complex kept = *one;
    *one = *other;
    *other = kept;
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
        int64_t pivot = k;
        for (int64_t i = k; i < n; i++)
            if (rough_size(a[i * n + k - 1]) > rough_size(a[pivot * n + k - 1]))
                pivot = i;
        for (int64_t j = 0; pivot != k && j < n; j++)
            swap(&a[pivot * n + j], &a[k * n + j]);
        for (int64_t i = 0; pivot != k && i < n; i++)
            swap(&a[i * n + pivot], &a[i * n + k]);
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

int eigenvalues(int64_t n, double complex *h, double complex *values)
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

void solve(int64_t n, int64_t m, double complex *M, double complex *R)
{
    for (int64_t k = 0; k < n; k++) {
        int64_t pivot = k;
        for (int64_t i = k + 1; i < n; i++)
            if (rough_size(M[i * n + k]) > rough_size(M[pivot * n + k]))
                pivot = i;
        for (int64_t j = k; pivot != k && j < n; j++)
            swap(&M[k * n + j], &M[pivot * n + j]);
        for (int64_t j = 0; pivot != k && j < m; j++)
            swap(&R[k * m + j], &R[pivot * m + j]);
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

double largest_singular_value(int64_t n, const double complex *M)
{
    double complex square[36] = {0}, values[6];
    double largest = 0;
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++)
            for (int64_t k = 0; k < n; k++)
                square[i * n + j] += conj(M[k * n + i]) * M[k * n + j];
    if (eigenvalues(n, square, values))
        return NAN;
    for (int64_t i = 0; i < n; i++)
        largest = fmax(largest, cabs(values[i]));
    return sqrt(largest);
}
