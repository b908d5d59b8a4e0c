/* Poses that no motion may pass: a collapsed leg, a pitch of 90 degrees, a singular leg Jacobian. */
#ifndef POSE_LIMITS_H
#define POSE_LIMITS_H

#include "internal.h"
#include "message.h"
#include "model.h"

/* The legs at one state, and on which side of the singular poses it lies. */
typedef struct {
    double length[6];
    double length_rate[6];
    double handedness; /* sign of det J; 0 is unknown */
} leg_state;

INTERNAL_BEGIN
/* Legs at a state; 1 if a motion of this handedness (0: any) may pass it, else 0 and the reason. */
int check_pose(const double x[N_STATES], const double p[N_PARAMETERS], double handedness, leg_state *legs,
               char message[MESSAGE_SIZE]);
INTERNAL_END

#endif
