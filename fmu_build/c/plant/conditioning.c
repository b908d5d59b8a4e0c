#include "conditioning.h"

#include <math.h>
#include <string.h>

#define N N_LEGS

double factorise(double a[N][N], double b[N])
{
    double determinant = 1;
    for (int j = 0; j < N; j++) {
        int pivot = j;
        for (int i = j + 1; i < N; i++)
            if (fabs(a[i][j]) > fabs(a[pivot][j]))
                pivot = i;
        if (!(fabs(a[pivot][j]) > 0))
            return 0; /* also for NaN */
        if (pivot != j) {
            double row[N];
            memcpy(row, a[j], sizeof row);
            memcpy(a[j], a[pivot], sizeof row);
            memcpy(a[pivot], row, sizeof row);
            if (b) {
                double kept = b[j];
                b[j] = b[pivot];
                b[pivot] = kept;
            }
            determinant = -determinant;
        }
        determinant *= a[j][j];
        double reciprocal = 1 / a[j][j];
        for (int i = j + 1; i < N; i++) {
            double factor = a[i][j] *= reciprocal;
            for (int k = j + 1; k < N; k++)
                a[i][k] -= factor * a[j][k];
            if (b)
                b[i] -= factor * b[j];
        }
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
    double lu[N][N], sum = 0;
    memcpy(lu, jacobian, sizeof lu);
    if (factorise(lu, NULL) == 0)
        return INFINITY;
    /* Frobenius norm of the inverse, column by column; the order of its columns, that of the pivots, does not matter */
    for (int column = 0; column < N; column++) {
        double v[N];
        for (int i = 0; i < N; i++) {
            v[i] = i == column;
            for (int k = 0; k < i; k++)
                v[i] -= lu[i][k] * v[k];
        }
        for (int i = N - 1; i >= 0; i--) {
            for (int k = i + 1; k < N; k++)
                v[i] -= lu[i][k] * v[k];
            v[i] /= lu[i][i];
            sum += v[i] * v[i];
        }
    }
    return sqrt(sum_of_squares(jacobian)) * sqrt(sum);
}

double condition_number(const double jacobian[N][N], double *determinant)
{
    double factors[N][N], mean = sum_of_squares(jacobian) / N;
    memcpy(factors, jacobian, sizeof factors);
    *determinant = factorise(factors, NULL);
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
