/* Interface of one machine with its sampled loop, in double precision, as plain C99: the C of c/loop for one member. No
   state of its own, no allocation, nothing of the C library but memcpy, sqrt and fabs: a native library and WebAssembly
   give the same bits.

   A machine is one block of 64-bit words, which the caller owns: harness/export/machine.py makes it from an experiment.
   1. Copy the block to memory aligned to 8 bytes, and open it there, once. To begin anew, copy it again. An open block
      cannot be moved.
   2. Run it, some rows at a time. At each row: readings, the command if a sample is due, the drives; the row is kept,
      its limits are checked; then the step from there.
   3. Read and write what fields hold between two calls, for example what acts from outside (MACHINE_INPUTS), gains
      (MACHINE_VALUES), or a motion (MACHINE_PLAN_GIVEN, if MACHINE_PLAN_KIND is 0): pose, rates and accelerations at the
      time MACHINE_PLAN_GIVEN_AT, from which the reference and the forces of feedforward are extrapolated. */
#ifndef MACHINE_H
#define MACHINE_H

#include "vectors.h"

/* Returns 0, or 1 if the block is of another version, cut off, or was opened before. */
OFFERED int64_t machine_open(int64_t *block, int64_t words);
/* Runs rows to before `to`, but not more than are kept, and not beyond the end of the run. Returns the next row. */
OFFERED int64_t machine_run(int64_t *block, int64_t to);
/* From now on the reference is where a hand wants the platform, MACHINE_PLAN_TARGET (6), through a filter with limits that
   begins in the motion of now; if there is a plan. */
OFFERED void machine_take(int64_t *block);
/* Takes over what MACHINE_TURN_WANTED holds, see turning.h: gains, delay, force limit, noise, quantisation. Returns 0, or 1
   and the position of the first value that is refused; then nothing has changed. */
OFFERED int64_t machine_turn(int64_t *block);
/* Poles, modes and margins of the linear loop as it is now, in MACHINE_TURN_RESULTS, see turning.h. Returns 0, or 1 if
   there are none. */
OFFERED int64_t machine_margins(int64_t *block);
/* The row at which it ended, or -1; and why: 0, or a FAILURE of lanes_table.h. */
OFFERED int64_t machine_ended(const int64_t *block);
OFFERED int64_t machine_failure(const int64_t *block);
/* What a field holds, by its number of machine_fields.h, such as MACHINE_INPUTS; NULL if the machine has none. */
OFFERED void *machine_field(int64_t *block, int64_t field);

#endif
