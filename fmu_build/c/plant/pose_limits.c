#include "pose_limits.h"

#include <math.h>

#include "conditioning.h"
#include "kernel.h"
#include "plant_table.h"

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
        write_message(message, "the platform has passed a singular pose since the last internal step; the legs cannot "
                               "hold it there");
        return 0;
    }
    if (!(number < SINGULAR_CONDITION_NUMBER)) {
        write_message(message,
                      "condition number of the leg Jacobian = %.6g: the platform has reached a singular pose; the legs "
                      "cannot hold it there",
                      number);
        return 0;
    }
    *handedness = side;
    return 1;
}
