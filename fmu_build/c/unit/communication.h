/* Checks of experiments and communication steps that all components share. */
#ifndef COMMUNICATION_H
#define COMMUNICATION_H

#include "component.h"
#include "message.h"

INTERNAL_BEGIN
/* A finite start time, and a stop time not before it. */
outcome check_experiment(double start_time, double stop_time, char message[MESSAGE_SIZE]);
/* A step from the current time `now`, forward, not beyond the stop time, within the rounding of importers' clocks. */
outcome check_step(double now, double stop_time, double time, double step, char message[MESSAGE_SIZE]);
int all_finite(const double values[], int n);
INTERNAL_END

#endif
