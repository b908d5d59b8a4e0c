#include "pose_limits.h"

#include <math.h>
#include <string.h>

#include "kernel.h"
#include "plant_table.h"

#define N N_LEGS

/* LU factors in place with partial pivoting, rows swapped as `order` says; the determinant. */
static double factorise(double a[N][N], int order[N])
{
    double determinant = 1;
    for (int i = 0; i < N; i++)
        order[i] = i;
    for (int j = 0; j < N; j++) {
        int pivot = j;
        for (int i = j + 1; i < N; i++)
            if (fabs(a[i][j]) > fabs(a[pivot][j]))
                pivot = i;
        if (!(fabs(a[pivot][j]) > 0))
            return 0; /* also for a NaN */
        if (pivot != j) {
            double row[N];
            memcpy(row, a[j], sizeof row);
            memcpy(a[j], a[pivot], sizeof row);
            memcpy(a[pivot], row, sizeof row);
            int swapped = order[j];
            order[j] = order[pivot];
            order[pivot] = swapped;
            determinant = -determinant;
        }
        determinant *= a[j][j];
        double reciprocal = 1 / a[j][j];
        for (int i = j + 1; i < N; i++) {
            double factor = a[i][j] *= reciprocal;
            for (int k = j + 1; k < N; k++)
                a[i][k] -= factor * a[j][k];
        }
    }
    return determinant;
}

/* Frobenius norm of the inverse, column by column. */
static double norm_of_inverse(double lu[N][N], const int order[N])
{
    double sum = 0;
    for (int column = 0; column < N; column++) {
        double v[N];
        for (int i = 0; i < N; i++) {
            v[i] = order[i] == column;
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
    return sqrt(sum);
}

/* In Frobenius norms: between the spectral condition number and six times it. Any upper bound below the limit may
   be given instead: kappa <= 2 / |det J| (|J|_F / sqrt n)^n (Guggenheimer, Edelman & Johnson 1995) costs less. */
static double condition_number(const double jacobian[N][N], double *determinant)
{
    int order[N];
    double factors[N][N], squares = 0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            squares += jacobian[i][j] * jacobian[i][j];
    memcpy(factors, jacobian, sizeof factors);
    *determinant = factorise(factors, order);
    double mean = squares / N, bound = 2 * mean * mean * mean / fabs(*determinant);
    if (bound < SINGULAR_CONDITION_NUMBER)
        return bound;
    return *determinant == 0 ? INFINITY : sqrt(squares) * norm_of_inverse(factors, order);
}

void find_legs(const double x[N_STATES], const double p[N_PARAMETERS], leg_state *legs)
{
    kernel_legs(x, p, legs->length, legs->length_rate, legs->jacobian[0], &legs->rho);
}

int check_pose(const leg_state *legs, double pitch, double *handedness, char message[MESSAGE_SIZE])
{
    if (!(fabs(pitch) < LARGEST_PITCH)) {
        char name[NAME_SIZE];
        write_slot_name(FIRST_STATE + X_PITCH, name);
        write_message(message, "%s = %.6g rad: the pitch has reached 90 degrees", name, pitch);
        return 0;
    }
    for (int i = 0; i < N_LEGS; i++)
        if (!(legs->length[i] > SHORTEST_LEG * legs->rho)) {
            write_message(message, "leg_length[%d] = %.6g m: the leg has collapsed", i + 1, legs->length[i]);
            return 0;
        }
    double determinant, number = condition_number(legs->jacobian, &determinant), side = determinant > 0 ? 1 : -1;
    if (*handedness != 0 && *handedness != side) {
        write_message(message, "the platform has passed a singular pose, where the legs cannot hold it, since the "
                               "last internal step");
        return 0;
    }
    if (!(number < SINGULAR_CONDITION_NUMBER)) {
        write_message(message,
                      "condition number of the leg Jacobian = %.6g: the platform has reached a singular pose, where "
                      "the legs cannot hold it",
                      number);
        return 0;
    }
    *handedness = side;
    return 1;
}
