/* Validity of the parameters: the checks of gough_stewart.model.platform_checks that concern the plant. */
#ifndef PARAMETERS_H
#define PARAMETERS_H

#include "component.h"
#include "model.h"
#include "plant_table.h"

INTERNAL_BEGIN
/* 1 if the inertia is physically possible, else 0 and the reason. */
int check_inertia(const double p[N_PARAMETERS], char message[MESSAGE_SIZE]);
/* 1 if no two joints of base or platform coincide and the centres of mass are on the legs, else 0 and the reason. */
int check_geometry(const double p[N_PARAMETERS], const double leg_length[N_LEGS], char message[MESSAGE_SIZE]);
/* What a plant with bristles or springs needs besides the bounds of each value, as model/platform_checks.py. */
int check_parts(const double p[N_PARAMETERS], char message[MESSAGE_SIZE]);
/* Motors are near the lengths of the legs at the start. */
int check_motors(const double x[N_STATES], const double leg_length[N_LEGS], char message[MESSAGE_SIZE]);
INTERNAL_END

#endif
