/* Poses with given leg lengths, row after row of a log: Newton's method from the pose of the row before. */
#define WIDTH 1
#include "conditioning.h"
#include "kernel.h"
#include "vectors.h"

#include <math.h>

enum { MOST_ITERATIONS = 30 };
/* Bound of a Newton step, in sizes of the platform and in rad; a smaller pivot, in row sums, is a singular pose. */
#define LARGEST_STEP 0.5
#define SMALLEST_PIVOT 1e-12

typedef struct {
    double p[N_PARAMETERS]; /* those of the geometry */
    double size;            /* of the platform [m] */
} geometry;

/* Leg lengths at a pose x, y, z, roll, pitch, yaw, and their rates by a twist [v; rho w]. */
static void legs_at(const geometry *g, const double pose[6], double length[6], double jacobian[6][6], double *rho)
{
    double x[N_STATES] = {0}, rate[6];
    memcpy(x, pose, 6 * sizeof *pose);
    kernel_legs(x, g->p, length, rate, jacobian[0], rho);
}

/* Moves a pose by a twist [v; rho w], shortened to LARGEST_STEP; the angles by their rates. */
static void move(const geometry *g, double pose[6], const double twist[6], double rho)
{
    const double w[3] = {twist[3] / rho, twist[4] / rho, twist[5] / rho};
    double shift = sqrt(twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]) / g->size;
    double turn = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    double share = LARGEST_STEP / fmax(LARGEST_STEP, fmax(shift, turn));
    double sc = sin(pose[5]), cc = cos(pose[5]), across = cc * w[0] + sc * w[1];
    double rates[3] = {across / cos(pose[4]), cc * w[1] - sc * w[0], w[2] + tan(pose[4]) * across};
    for (int i = 0; i < 3; i++) {
        pose[i] += share * twist[i];
        pose[3 + i] += share * rates[i];
    }
}

/* The pose of one row from a guess, which it replaces: the largest length error, or NaN if none was found on the side
   of the singular poses where det J has the sign of `side`. */
static double found_pose(const geometry *g, double side, double tolerance, const double length[6], double pose[6],
                         int *iterations)
{
    double longest = 0;
    for (int leg = 0; leg < 6; leg++)
        longest = fmax(longest, length[leg]);
    for (*iterations = 0; *iterations <= MOST_ITERATIONS; ++*iterations) {
        double at[6], jacobian[6][6], error[6], rho, largest = 0;
        legs_at(g, pose, at, jacobian, &rho);
        for (int leg = 0; leg < 6; leg++) {
            error[leg] = length[leg] - at[leg];
            largest = fmax(largest, fabs(error[leg]));
        }
        if (!(solve(jacobian, SMALLEST_PIVOT, 1, error) * side > 0) || !(fabs(pose[4]) < LARGEST_PITCH))
            return NAN;
        if (largest <= tolerance * longest)
            return largest;
        move(g, pose, error, rho);
    }
    return NAN;
}

/* Poses of rows of leg lengths; the first from a guess, whose assembly mode they keep. A row with a length that is NaN,
   or that no pose was found for, has NaN for its residual and is passed over. Returns the number of the latter. */
OFFERED size_t poses_of_lengths(const double base[6][3], const double platform[6][3], double size, const double guess[6],
                                double tolerance, size_t rows, const double lengths[][6], double poses[][6],
                                double residuals[], int iterations[])
{
    geometry g = {.size = size};
    double at[6], jacobian[6][6], last[6], change[6] = {0}, rho;
    size_t lost = 0;
    memcpy(g.p + P_BASE_POINTS, base, 18 * sizeof(double));
    memcpy(g.p + P_PLATFORM_POINTS, platform, 18 * sizeof(double));
    memcpy(last, guess, sizeof last);
    legs_at(&g, guess, at, jacobian, &rho);
    double side = solve(jacobian, SMALLEST_PIVOT, 1, at);
    for (size_t k = 0; k < rows; k++) {
        int is_known = 1;
        for (int leg = 0; leg < 6; leg++)
            is_known &= !isnan(lengths[k][leg]);
        for (int i = 0; i < 6; i++)
            poses[k][i] = is_known ? last[i] + change[i] : NAN;
        iterations[k] = 0;
        residuals[k] = is_known ? found_pose(&g, side, tolerance, lengths[k], poses[k], &iterations[k]) : NAN;
        if (is_known && isnan(residuals[k])) { /* not from the extrapolated pose: from the last one */
            memcpy(poses[k], last, sizeof last);
            residuals[k] = found_pose(&g, side, tolerance, lengths[k], poses[k], &iterations[k]);
            lost += isnan(residuals[k]) != 0;
        }
        int is_found = !isnan(residuals[k]), follows = is_found && k > 0 && !isnan(residuals[k - 1]);
        for (int i = 0; i < 6; i++) {
            change[i] = follows ? poses[k][i] - poses[k - 1][i] : 0;
            last[i] = is_found ? poses[k][i] : last[i];
        }
    }
    return lost;
}
