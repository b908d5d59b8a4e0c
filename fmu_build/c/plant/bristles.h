/* What the kernel has of a plant with bristles besides the functions of all plants (kernel.h). */
#ifndef BRISTLES_H
#define BRISTLES_H

#include "internal.h"

INTERNAL_BEGIN
/* rates d [1/s] at which the bristles forget: dz/dt = v - d z */
void kernel_decays(const double x[], const double p[], double decay[]);
/* the same rates d; the gain [1/s], column by column: gain dz/dt is taken from the accelerations, of motors if legs yield,
   else of the platform; so is gain (ratio z), with the ratio [1/s] of stiffness and damping; z in fast sliding [m]; v */
void kernel_grip(const double x[], const double p[], double decay[], double gain[], double ratio[], double reach[],
                 double sliding[]);
/* the velocities v [m/s] at which friction acts */
void kernel_sliding(const double x[], const double p[], double sliding[]);
INTERNAL_END

#endif
