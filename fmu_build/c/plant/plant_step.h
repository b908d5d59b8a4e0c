/* A communication step of the plant. */
#ifndef PLANT_STEP_H
#define PLANT_STEP_H

#include "plant.h"

INTERNAL_BEGIN
/* Implements `component_step`. */
outcome step_plant(component *c, double time, double step, const step_observer *observer, double *reached);
INTERNAL_END

#endif
