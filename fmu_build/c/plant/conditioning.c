#include "conditioning.h"

#include <math.h>
#include <string.h>

#define N N_LEGS

static void swap(int n, double one[], double other[])
{
    for (int k = 0; k < n; k++) {
        double kept = one[k];
        one[k] = other[k];
        other[k] = kept;
    }
}

double solve(double a[N][N], double smallest, int m, double b[])
{
    double determinant = 1;
    for (int j = 0; j < N; j++) {
        int pivot = j;
        for (int i = j + 1; i < N; i++)
            if (fabs(a[i][j]) > fabs(a[pivot][j]))
                pivot = i;
        if (!(fabs(a[pivot][j]) > smallest))
            return 0; /* also for NaN */
        if (pivot != j) {
            swap(N, a[j], a[pivot]);
            swap(m, b + j * m, b + pivot * m);
            determinant = -determinant;
        }
        determinant *= a[j][j];
        double reciprocal = 1 / a[j][j];
        for (int i = j + 1; i < N; i++) {
            double factor = a[i][j] * reciprocal;
            for (int k = j + 1; k < N; k++)
                a[i][k] -= factor * a[j][k];
            for (int k = 0; k < m; k++)
                b[i * m + k] -= factor * b[j * m + k];
        }
    }
    for (int i = N - 1; i >= 0; i--)
        for (int k = 0; k < m; k++) {
            for (int j = i + 1; j < N; j++)
                b[i * m + k] -= a[i][j] * b[j * m + k];
            b[i * m + k] /= a[i][i];
        }
    return determinant;
}

static double sum_of_squares(const double a[N][N])
{
    double squares = 0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            squares += a[i][j] * a[i][j];
    return squares;
}

double exact_condition_number(const double jacobian[N][N])
{
    double factors[N][N], inverse[N][N] = {{0}};
    memcpy(factors, jacobian, sizeof factors);
    for (int i = 0; i < N; i++)
        inverse[i][i] = 1;
    if (solve(factors, 0, N, inverse[0]) == 0)
        return INFINITY;
    return sqrt(sum_of_squares(jacobian)) * sqrt(sum_of_squares((const double(*)[N])inverse));
}

double condition_number(const double jacobian[N][N], double *determinant)
{
    double factors[N][N], mean = sum_of_squares(jacobian) / N;
    memcpy(factors, jacobian, sizeof factors);
    *determinant = solve(factors, 0, 0, factors[0]);
    double bound = 2 * mean * mean * mean / fabs(*determinant);
    return bound < SINGULAR_CONDITION_NUMBER ? bound : exact_condition_number(jacobian);
}

int pose_failure(const double x[], int n, const double length[N], const double jacobian[N][N], double rho, double *side)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(x[i]))
            return FAILURE_NOT_FINITE;
    if (!(fabs(x[X_PITCH]) < LARGEST_PITCH))
        return FAILURE_PITCHED;
    int shortest = 0;
    for (int i = 1; i < N; i++)
        if (length[i] < length[shortest])
            shortest = i;
    if (!(length[shortest] > SHORTEST_LEG * rho))
        return FAILURE_COLLAPSED + shortest;
    double determinant, number = condition_number(jacobian, &determinant), new_side = determinant > 0 ? 1 : -1;
    if (*side != 0 && *side != new_side)
        return FAILURE_PASSED_SINGULAR;
    if (!(number < SINGULAR_CONDITION_NUMBER))
        return FAILURE_SINGULAR;
    *side = new_side;
    return FAILURE_GOES_ON;
}
