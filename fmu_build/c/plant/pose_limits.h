/* Limits of the pose: leg length 0, a pitch of 90 degrees, a singular leg Jacobian. */
#ifndef POSE_LIMITS_H
#define POSE_LIMITS_H

#include "internal.h"
#include "message.h"
#include "model.h"
#include "plant_table.h"

/* The legs at one state. */
typedef struct {
    double length[N_LEGS];
    double length_rate[N_LEGS];
    double jacobian[N_LEGS][N_LEGS]; /* angles scaled to lengths by rho */
    double rho;
} leg_state;

INTERNAL_BEGIN
void find_legs(const double x[N_STATES], const double p[N_PARAMETERS], leg_state *legs);
/* 1 if the pose is within the limits, else 0 and the reason. `handedness` is the sign of det J of the motion so far; if
   it is 0, it is set from this pose. */
int check_pose(const leg_state *legs, double pitch, double *handedness, char message[MESSAGE_SIZE]);
INTERNAL_END

#endif
