/* Interface of the sampled loop for many members, eight per vector: at each row the sensors, the controller, the limits,
   the delay and the drives, then a step of the plant. No state of its own, no allocation.

   What each component computes is in `components.h`, generated from its Python source; here are clocks and memory. */
#ifndef LOOP_H
#define LOOP_H

#include "lanes.h"

/* Of `kinds`: a controller elsewhere, which puts its forces into `next` between `loop_read` and `loop_act`. */
enum { ASKED = 4 };

/* Numbers by row, element and member: each distance is in numbers, that of members is 1, or 0 if all have the same. */
typedef struct {
    const double *at;
    int64_t row, element, member;
} table;

/* The same of indices; there is one element. */
typedef struct {
    const int64_t *at;
    int64_t row, member;
} indices;

/* Where rows of N members are written, numbers or flags of a byte: row, element, then members side by side. NULL:
   nowhere. */
typedef struct {
    void *at;
    int64_t row, element;
} rows_out;

/* What is kept of some rows: elements of a row, see ROW_ELEMENTS in components.h. */
typedef struct {
    const int64_t *place; /* by row of the run: where it is kept, or -1 */
    int64_t size;
    const int64_t *elements;
    rows_out to;
} kept_rows;

/* Who takes the rows as they come, in the cache, so that they need not be written: folds, see `folds_rows` of
   c/folds/folds.c, and what is kept of some rows. */
typedef struct {
    void (*fold)(const void *folding, int64_t vector, int64_t first, int64_t rows, int64_t elements, const int64_t *ends,
                 const double *chunk); /* NULL: none */
    const void *folding;
    double *latest; /* (ROW_ELEMENTS, M): the row before the next one */
    int64_t n_kept;
    const kept_rows *kept;
} taker;

typedef struct {
    int64_t members; /* N, at most those of the batch; the others are not read and not written */
    int64_t last;    /* row of the run's end: after it there is no step */

    /* clocks: plant steps a sample; those between readings, 0 for readings at the samples */
    int64_t every, reading_every;
    indices sampled;   /* by sample: its row */
    double plant_step; /* [s] */
    double tolerance;  /* of error-controlled internal steps */
    int64_t substeps;  /* RK4 steps a plant step; 0 for error-controlled ones */

    /* by row (30); by sample (6), (6) [N]: `at` is NULL where there is none */
    table reference, feedforward, injection;

    /* the linear controller y = C x + D u, x+ = A x + B u, as the elements of [C D; A B] that are not zero, row by row */
    int64_t kinds;   /* parts of u: errors; references, measurements; these and the excess. 0: no controller; ASKED */
    int64_t size;    /* number of signals that it uses */
    int64_t n_states;
    void (*law)(const double *memory, double *next, int64_t stride); /* a user's, see c/law/law.c, with kinds = 2 and
                                                                        all signals; NULL: the linear one */
    int64_t entries;
    const int64_t *entry_row, *entry_column;
    table values;           /* one row, `entries` elements */
    int64_t rest_entries; /* of R, of a controller that may be off: it rests in x = R u */
    const int64_t *rest_row, *rest_column;
    table rests;
    const int64_t *used;    /* positions of its signals among all */
    table jacobian, inverse; /* by sample (36), for task space; NULL for leg space */

    /* sensors: signals with noise, and their deviations, one row; one row (24) of the
       coefficients of each signal's sensor */
    const int64_t *senses; /* by signal: 1 if its sensor does anything; of elastic legs 2 more to read at the motor */
    int64_t n_noisy;
    const int64_t *noisy; /* (n_noisy, 2): the first element of each and their number */
    table deviations, sensors;

    /* coefficients of the limits and the drives, one row, NULL if they do nothing; of what takes over from manual
       operation; samples of delay, and the most */
    table limits, drives, takeover, delay;
    int64_t most_delay;

    /* ends of runs, one row: lengths of the strokes [m], NULL if they end no run; largest distance from the reference */
    table shortest, longest, farthest;

    /* memory of the members, (size, M) as the states of the batch */
    double *signals;     /* 24: at the present row */
    double *measured;    /* 24 */
    int64_t *streams;    /* 4: of the noise, words of 32 bits, see noise.h */
    double *memory;      /* n_states + size of u: x and u; of a user's law what law.c says */
    double *next;        /* 6 + n_states: y and the next x */
    double *pose;        /* 6: in task space */
    double *lengths;     /* 6: at the last sample, in task space */
    double *command;     /* 6 */
    double *excess;      /* 6 */
    double *limited;     /* 6: whether the force limit acts, 1 or 0 */
    double *planned;     /* LIMIT_STATES: of the limits */
    double *delayed;     /* 6 (most_delay + 1): allowed forces by sample */
    double *target;      /* 6: of the drives */
    double *driven;      /* DRIVE_STATES: of the drives */
    double *acting;      /* 6: forces [N] */
    double *cut;         /* 6: whether the leg has no force, 1 or 0; NULL, as the next two: nothing can fail */
    double *frozen;      /* 24: whether the reading stays */
    double *held;        /* 24: readings of the last sample */
    int64_t *at_row;     /* (blocks): next row of each vector */
    int64_t *ended;      /* (M): row of the member's end, or -1 */
    double *off;         /* 6: whether the controller is off, 1 or 0; NULL, as the next two: it never is */
    double *manual_force; /* 6: the command then */
    double *transfer;    /* 6: what the controller's own command lacks of it */

    /* what is kept: by row since `first_row`, and by sample */
    int64_t first_row;
    rows_out row_signals, row_results, row_forces, row_motors; /* the last of elastic legs */
    rows_out row_force_limited, row_rate_limited;              /* flags */
    rows_out sample_measured, sample_state, sample_command, sample_limited;
    const taker *takes; /* NULL: nobody */
} loop;

/* Runs the vectors from `first` to before `end` to the rows before `to`, each with the step from there, or until about
   `most_work` internal steps of eight members are done: call it again until it returns 1. Calls for different vectors can
   run in parallel. Members whose `running` is 0 stay as they are. A member that ends has a
   FAILURE, and its row in `ended`.

   At a row: readings; if a sample is due, the command; the drives; the row is kept; its limits are checked. */
OFFERED int64_t loop_run(const batch *members, const loop *l, int64_t first, int64_t end, int64_t to,
                         int64_t most_work);

#if WIDTH == 1
/* Reads the sensors before the first sample, and feeds the controller with that: `measured` and u. */
void loop_begin(const batch *members, const loop *l);
#endif

/* The same in two calls for plants that are stepped elsewhere: the readings at a row, then everything up to its step, in
   which `acting` acts. They know the plant by its `signals` alone, and write no results; of members also `running`. */
OFFERED void loop_read(const batch *members, const loop *l, int64_t row);
OFFERED void loop_act(const batch *members, const loop *l, int64_t row);

#endif
