#include "parameters.h"

#include <math.h>

#include "plant_table.h"

/* Sylvester: a symmetric matrix is positive definite when its leading minors are positive. */
static int is_positive_definite(double m[3][3])
{
    double two = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    double three = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                   m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                   m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    return m[0][0] > 0 && two > 0 && three > 0;
}

int check_inertia(const double p[N_PARAMETERS], char message[MESSAGE_SIZE])
{
    const double *J = p + P_PLATFORM_INERTIA;
    double size = 0, unit[3][3];
    for (int i = 0; i < 9; i++)
        size = fmax(size, fabs(J[i]));
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < a; b++)
            if (fabs(J[3 * a + b] - J[3 * b + a]) > INERTIA_SLACK * size) {
                write_message(message,
                              "platform_inertia is not symmetric: [%d,%d] = %g but [%d,%d] = %g kg.m2; set both to the "
                              "same value (minus the product of inertia)",
                              b + 1, a + 1, J[3 * b + a], a + 1, b + 1, J[3 * a + b]);
                return 0;
            }
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            unit[a][b] = size > 0 ? (J[3 * a + b] + J[3 * b + a]) / 2 / size : 0;
    if (!is_positive_definite(unit)) {
        write_message(message, "platform_inertia is not positive definite; expected principal moments > 0 kg.m2");
        return 0;
    }
    /* triangle inequality: no principal moment above (1 + slack) times the sum of the others */
    double trace = unit[0][0] + unit[1][1] + unit[2][2];
    double largest = trace * (1 + INERTIA_SLACK) / (2 + INERTIA_SLACK);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            unit[a][b] = (a == b) * largest - unit[a][b];
    if (!is_positive_definite(unit)) {
        write_message(message,
                      "platform_inertia is unphysical: the largest principal moment exceeds the sum of the others "
                      "(triangle inequality); check the units and that it is about the centre of mass");
        return 0;
    }
    return 1;
}

static int joints_are_apart(const double points[3 * N_LEGS], const char *name, char message[MESSAGE_SIZE])
{
    double nearest = INFINITY, farthest = 0;
    int one = 0, other = 0;
    for (int i = 0; i < N_LEGS; i++)
        for (int j = 0; j < i; j++) {
            double square = 0;
            for (int a = 0; a < 3; a++)
                square += (points[3 * i + a] - points[3 * j + a]) * (points[3 * i + a] - points[3 * j + a]);
            double distance = sqrt(square);
            farthest = fmax(farthest, distance);
            if (distance < nearest) {
                nearest = distance;
                one = j;
                other = i;
            }
        }
    if (nearest > COINCIDENCE * farthest)
        return 1;
    write_message(message, "%s: joints %d and %d coincide; expected six different points (a double joint needs a small "
                           "offset)", name, one + 1, other + 1);
    return 0;
}

int check_geometry(const double p[N_PARAMETERS], const double leg_length[N_LEGS], char message[MESSAGE_SIZE])
{
    if (!joints_are_apart(p + P_BASE_POINTS, "base_points", message) ||
        !joints_are_apart(p + P_PLATFORM_POINTS, "platform_points", message))
        return 0;
    double shortest = leg_length[0];
    for (int i = 1; i < N_LEGS; i++)
        shortest = fmin(shortest, leg_length[i]);
    const double com[2] = {p[P_LEG_LOWER_COM], p[P_LEG_UPPER_COM]};
    for (int part = 0; part < 2; part++)
        if (com[part] > shortest) { /* the legs are identical, so the shortest one limits both values */
            write_message(message, "leg_%s_com is %g m; expected at most the shortest leg length at the start, %g m",
                          part ? "upper" : "lower", com[part], shortest);
            return 0;
        }
    return 1;
}
