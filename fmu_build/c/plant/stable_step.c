#include "plant.h"

#include <math.h>
#include <string.h>

#include "kernel.h"

#if HAS_BRISTLES || HAS_SPRINGS
/* |A^1024|^(1/1024) is within 2 % of the spectral radius for norms that differ by 10^9. */
enum { SQUARINGS = 10 };

static double largest_element(double a[N_STATES][N_STATES])
{
    double largest = 0;
    for (int i = 0; i < N_STATES; i++)
        for (int j = 0; j < N_STATES; j++)
            largest = fmax(largest, fabs(a[i][j]));
    return largest;
}

static void square(double a[N_STATES][N_STATES])
{
    double product[N_STATES][N_STATES];
    memset(product, 0, sizeof product);
    for (int i = 0; i < N_STATES; i++)
        for (int k = 0; k < N_STATES; k++)
            for (int j = 0; j < N_STATES; j++)
                product[i][j] += a[i][k] * a[k][j];
    memcpy(a, product, sizeof product);
}

static double spectral_radius(double a[N_STATES][N_STATES])
{
    double logarithm = 0, power = 1;
    for (int k = 0;; k++) {
        double size = largest_element(a);
        if (!(size > 0))
            return 0;
        logarithm += log(size) / power;
        if (k == SQUARINGS)
            return exp(logarithm);
        for (int i = 0; i < N_STATES; i++)
            for (int j = 0; j < N_STATES; j++)
                a[i][j] /= size;
        square(a);
        power *= 2;
    }
}

double stable_step(const double x[N_STATES], const double u[N_INPUTS], const double p[N_PARAMETERS])
{
    static const double no_input[N_INPUTS] = {0}, no_parameter[N_PARAMETERS] = {0};
    double rest[N_STATES], direction[N_STATES] = {0}, change[N_STATES], results[N_RESULTS], a[N_STATES][N_STATES];
    memcpy(rest, x, sizeof rest);
    memset(rest + X_VELOCITY, 0, sizeof(double) * 6);
#if HAS_BRISTLES
    memset(rest + X_LEG_BRISTLE, 0, sizeof(double) * N_LEGS);
#endif
#if HAS_SPRINGS
    memset(rest + X_MOTOR_VELOCITY, 0, sizeof(double) * N_LEGS);
#endif
    for (int k = 0; k < N_STATES; k++) {
        direction[k] = 1;
        kernel_forward(rest, u, p, direction, no_input, no_parameter, change, results);
        direction[k] = 0;
        for (int i = 0; i < N_STATES; i++)
            a[i][k] = change[i];
    }
    double largest = LARGEST_PRODUCT / spectral_radius(a);
#if HAS_BRISTLES
    largest = fmin(largest, LARGEST_FIXED_STEP);
#endif
    return largest;
}
#else
double stable_step(const double x[N_STATES], const double u[N_INPUTS], const double p[N_PARAMETERS])
{
    (void)x, (void)u, (void)p;
    return INFINITY;
}
#endif
