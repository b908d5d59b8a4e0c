/* What the kernel has of a plant with bristles besides the functions of all plants (kernel.h). */
#ifndef BRISTLES_H
#define BRISTLES_H

#include "internal.h"

INTERNAL_BEGIN
/* rates d [1/s] at which the bristles forget: dz/dt = v - d z */
void kernel_decays(const double x[], const double p[], double decay[]);
INTERNAL_END

#endif
