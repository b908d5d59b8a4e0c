/* A control law that a user wrote, on eight members at a time: compiled for one law, called by c/loop. */
/* The C library's functions, for the range and the bits that a user expects. */
#define WITH_C_LIBRARY
#include "elementary.h"

/* no fused operations, so that the law has the bits of the user's */
#ifdef __clang__
#pragma clang fp contract(off) reciprocal(off)
#endif

#define EACH(name, arguments, value)                                                                                   \
    static inline lanes each_##name arguments                                                                          \
    {                                                                                                                  \
        for (int lane = 0; lane < WIDTH; lane++)                                                                       \
            LANE(x, lane) = value;                                                                                     \
        return x;                                                                                                      \
    }
#define OF_ONE(name) EACH(name, (lanes x), name(LANE(x, lane)))
#define OF_TWO(name) EACH(name, (lanes x, lanes y), name(LANE(x, lane), LANE(y, lane)))

#include "law_step.h"

/* From `memory` (N_MEMORY, 8): its states, all signals of the reference, all readings, the time of the sample, the
   accelerations of the reference, and coefficients; to `next` (6 + states, 8): forces and the next states. Rows are
   `stride` numbers apart. */
OFFERED void law_step(const double *memory, double *next, int64_t stride)
{
    lanes inputs[N_MEMORY], outputs[N_NEXT];
    for (int i = 0; i < N_MEMORY; i++)
        inputs[i] = get(memory + i * stride);
    law(inputs, outputs);
    for (int i = 0; i < N_NEXT; i++)
        put(next + i * stride, outputs[i]);
}
