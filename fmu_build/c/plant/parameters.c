#include "plant.h"

#include <math.h>

/* Sylvester: a symmetric matrix is positive definite when its leading minors are positive. */
static int is_positive_definite(double m[3][3])
{
    double two = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    double three = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                   m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                   m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    return m[0][0] > 0 && two > 0 && three > 0;
}

/* The inertia is physically possible. */
static outcome check_inertia(const double p[N_PARAMETERS], char message[MESSAGE_SIZE])
{
    const double *J = p + P_PLATFORM_INERTIA;
    double size = 0, unit[3][3];
    for (int i = 0; i < 9; i++)
        size = fmax(size, fabs(J[i]));
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < a; b++)
            if (fabs(J[3 * a + b] - J[3 * b + a]) > INERTIA_SLACK * size)
                return write_message(message, "platform_inertia is not symmetric: [%d,%d] = %g but [%d,%d] = %g kg.m2; set "
                                              "both to the same value (minus the product of inertia)",
                                     b + 1, a + 1, J[3 * b + a], a + 1, b + 1, J[3 * a + b]);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            unit[a][b] = size > 0 ? (J[3 * a + b] + J[3 * b + a]) / 2 / size : 0;
    if (!is_positive_definite(unit))
        return write_message(message, "platform_inertia is not positive definite; expected principal moments > 0 kg.m2");
    /* triangle inequality: no principal moment above (1 + slack) times the sum of the others */
    double trace = unit[0][0] + unit[1][1] + unit[2][2];
    double largest = trace * (1 + INERTIA_SLACK) / (2 + INERTIA_SLACK);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            unit[a][b] = (a == b) * largest - unit[a][b];
    if (!is_positive_definite(unit))
        return write_message(message, "platform_inertia is unphysical: the largest principal moment exceeds the sum of "
                                      "the others (triangle inequality); check the units and that it is about the "
                                      "centre of mass");
    return DONE;
}

static double square_of_distance(const double one[3], const double other[3])
{
    double square = 0;
    for (int a = 0; a < 3; a++)
        square += (one[a] - other[a]) * (one[a] - other[a]);
    return square;
}

/* Below which two joints of one body are one joint. */
static double distance_of_shared(const double points[3 * N_LEGS])
{
    double farthest = 0;
    for (int i = 0; i < N_LEGS; i++)
        for (int j = 0; j < i; j++)
            farthest = fmax(farthest, square_of_distance(points + 3 * i, points + 3 * j));
    return COINCIDENCE * sqrt(farthest);
}

outcome check_joints(const double p[N_PARAMETERS], char message[MESSAGE_SIZE])
{
    const double *base = p + P_BASE_POINTS, *platform = p + P_PLATFORM_POINTS;
    double near_base = distance_of_shared(base), near_platform = distance_of_shared(platform);
    for (int i = 0; i < N_LEGS; i++)
        for (int j = i + 1; j < N_LEGS; j++)
            if (sqrt(square_of_distance(base + 3 * i, base + 3 * j)) <= near_base &&
                sqrt(square_of_distance(platform + 3 * i, platform + 3 * j)) <= near_platform)
                return write_message(message, "base_points, platform_points: legs %d and %d share both joints; expected at "
                                              "most one of the two, so that no two legs are one", i + 1, j + 1);
    return DONE;
}

outcome check_start(const double p[N_PARAMETERS], const double x[N_STATES], const double leg_length[N_LEGS],
                    char message[MESSAGE_SIZE])
{
    static const int values[2] = {P_LEG_LOWER_COM, P_LEG_UPPER_COM};
    static const int factors[2] = {P_LEG_LOWER_COM_FACTOR, P_LEG_UPPER_COM_FACTOR};
    for (int part = 0; part < 2; part++) {
        double com[N_LEGS];
        int least = 0;
        for (int i = 0; i < N_LEGS; i++) {
            com[i] = p[values[part]] * p[factors[part] + i];
            if (leg_length[i] - com[i] < leg_length[least] - com[least])
                least = i;
        }
        if (leg_length[least] - com[least] < 0)
            return write_message(message, "leg_%s_com is %g m; expected at most the shortest leg length at the start, %g m "
                                          "(leg %d)", part ? "upper" : "lower", com[least], leg_length[least], least + 1);
    }
#if HAS_SPRINGS
    for (int i = 0; i < N_LEGS; i++) {
        double s = x[X_MOTOR_POSITION + i];
        if (!(fabs(s - leg_length[i]) <= LARGEST_STRETCH * leg_length[i]))
            return write_message(message, "motor_position[%d] is %g m, but leg_length[%d] %g m at the start; expected a "
                                          "stretch of at most %g %%: set motor_position with the pose, to leg length + "
                                          "force/stiffness", i + 1, s, i + 1, leg_length[i], 100 * LARGEST_STRETCH);
    }
#endif
    (void)x;
    return DONE;
}

outcome check_parameters(const double p[N_PARAMETERS], char message[MESSAGE_SIZE])
{
    if (check_inertia(p, message) != DONE)
        return NOT_POSSIBLE;
#if HAS_BRISTLES
    double model = p[P_LEG_FRICTION_MODEL];
    if (model != 1 && model != 2)
        return write_message(message, "leg_friction_model is %g; expected 1 (elasto_plastic) or 2 (lugre): smooth friction "
                                      "is a unit without bristles", model);
    for (int i = 0; i < N_LEGS; i++) {
        double factor = p[P_LEG_STATIC_FRICTION_FACTOR + i], of_coulomb = p[P_LEG_COULOMB_FRICTION_FACTOR + i];
        double coulomb = p[P_LEG_COULOMB_FRICTION] * of_coulomb;
        double fixed = p[P_LEG_STATIC_FRICTION] * (factor > 0 ? factor : of_coulomb), largest = fmax(coulomb, fixed);
        double stiffness = p[P_LEG_BRISTLE_STIFFNESS] * p[P_LEG_BRISTLE_STIFFNESS_FACTOR + i];
        double share = p[P_LEG_BREAKAWAY_SHARE] * p[P_LEG_BREAKAWAY_SHARE_FACTOR + i];
        if (!(coulomb > 0))
            return write_message(message, "leg_coulomb_friction is %g N in leg %d; stiction needs > 0 in each", coulomb,
                                 i + 1);
        if (fixed > 0 && fixed < coulomb)
            return write_message(message, "leg_static_friction is %g N, below leg_coulomb_friction = %g N; expected at "
                                          "least that, or 0 for the same friction at rest as in motion (leg %d)",
                                 factor > 0 ? fixed : fixed / of_coulomb, factor > 0 ? coulomb : coulomb / of_coulomb,
                                 i + 1);
        if (stiffness > 0 && largest / stiffness > LONGEST_PRESLIDING)
            return write_message(message, "leg_bristle_stiffness is %g N/m: legs would stick over %.3g m before they "
                                          "slide; expected %g N/m or more, or 0 to derive it (leg %d)", stiffness,
                                 largest / stiffness, largest / LONGEST_PRESLIDING, i + 1);
        if (share > LARGEST_SHARE)
            return write_message(message, "leg_breakaway_share is %g; expected at most %g, or 0 for the default (leg %d)",
                                 share, LARGEST_SHARE, i + 1);
    }
#endif
#if HAS_SPRINGS
    for (int i = 0; i < N_LEGS; i++) {
        const double pi = 3.14159265358979323846;
        double stiffness = p[P_LEG_STIFFNESS] * p[P_LEG_STIFFNESS_FACTOR + i];
        double armature = p[P_LEG_ARMATURE] * p[P_LEG_ARMATURE_FACTOR + i];
        double mass = p[P_LEG_UPPER_MASS] * p[P_LEG_UPPER_MASS_FACTOR + i] + p[P_PLATFORM_MASS] / 6;
        double least = 4 * pi * pi * SLOWEST_MODE * SLOWEST_MODE * mass;
        if (!(armature > 0))
            return write_message(message, "leg_armature is %g kg; a leg with leg_stiffness needs a motor with inertia: set "
                                          "leg_armature = J (2 pi/lead)^2 (leg %d)", armature, i + 1);
        if (!(stiffness >= least))
            return write_message(message, "leg_stiffness is %g N/m; expected %.3g N/m or more, at which the platform "
                                          "bounces at about %g Hz; rigid legs are a unit without springs (leg %d)",
                                 stiffness, least, SLOWEST_MODE, i + 1);
    }
#endif
    return DONE;
}
