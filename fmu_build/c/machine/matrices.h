/* Small dense matrices of complex numbers, by rows, for the analysis of a loop. */
#ifndef MATRICES_H
#define MATRICES_H

#include <complex.h>
#include <stdint.h>

/* products and quotients need not look for infinite parts */
#pragma STDC CX_LIMITED_RANGE ON

/* Eigenvalues (n) of a matrix (n, n), which is overwritten. Returns 0, or 1 if they do not converge. */
int eigenvalues(int64_t n, double complex *matrix, double complex *values);
/* X of M X = R, for M (n, n) and R (n, m): both are overwritten, R by X. Partial pivoting. */
void solve(int64_t n, int64_t m, double complex *M, double complex *R);
/* The largest singular value of M (n, n), n <= 6; NaN if it is not found. */
double largest_singular_value(int64_t n, const double complex *M);

#endif
