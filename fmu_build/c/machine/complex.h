/* Complex numbers and small dense systems of them, for the analysis of a loop. */
#ifndef COMPLEX_NUMBERS_H
#define COMPLEX_NUMBERS_H

#include <math.h>
#include <stdint.h>

typedef struct {
    double re, im;
} cplx;

static inline cplx cx(double re, double im)
{
    cplx z = {re, im};
    return z;
}

static inline cplx plus(cplx a, cplx b)
{
    return cx(a.re + b.re, a.im + b.im);
}

static inline cplx minus(cplx a, cplx b)
{
    return cx(a.re - b.re, a.im - b.im);
}

static inline cplx product(cplx a, cplx b)
{
    return cx(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
}

static inline cplx conjugate(cplx a)
{
    return cx(a.re, -a.im);
}

static inline double size_of(cplx a)
{
    return hypot(a.re, a.im);
}

/* scaled, so that no square overflows */
static inline cplx quotient(cplx a, cplx b)
{
    if (fabs(b.re) >= fabs(b.im)) {
        double r = b.im / b.re, d = b.re + b.im * r;
        return cx((a.re + a.im * r) / d, (a.im - a.re * r) / d);
    }
    double r = b.re / b.im, d = b.re * r + b.im;
    return cx((a.re * r + a.im) / d, (a.im * r - a.re) / d);
}

/* Eigenvalues (n) of a real matrix (n, n), which is overwritten; `work` has n n complex numbers. Returns 0, or 1 if they
   do not converge. */
int eigenvalues(int64_t n, double *matrix, cplx *work, cplx *values);
/* X of M X = R, for M (n, n) and R (n, m) by rows: both are overwritten, R by X. Partial pivoting. */
void solve(int64_t n, int64_t m, cplx *M, cplx *R);
/* The largest singular value of M (n, n), n <= 6, to 1e-6 of itself. */
double largest_singular_value(int64_t n, const cplx *M);

#endif
