/* Interface of a control law that a user wrote, on eight members at a time: compiled for one law, called by c/loop. */
#ifndef LAW_H
#define LAW_H

#include "vectors.h"

/* From `memory` (N_MEMORY, 8): its states, all signals of the reference, all readings, the time of the sample, the
   accelerations of the reference, and coefficients; to `next` (6 + states, 8): forces and the next states. Rows are
   `stride` numbers apart. */
OFFERED void law_step(const double *memory, double *next, int64_t stride);

#endif
