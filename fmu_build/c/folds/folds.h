/* Interface of the library that folds rows of many members, eight per vector. No state, no allocation; calls for
   different members can run in parallel. A member's bits depend on its own numbers alone: not on the number of members,
   its place, or the size of blocks. */
#ifndef FOLDS_H
#define FOLDS_H

#include "vectors.h"

/* A fold: a kernel with its places in a row, in the states and in the parameters of a vector. */
typedef struct {
    int64_t kernel;
    const int64_t *places; /* of its columns */
    int64_t state, parameter;
} fold;

/* The folds of N members in vectors of eight, the last one perhaps not full. */
typedef struct {
    int64_t n_folds, n_states, n_parameters, n_checked;
    const fold *folds;
    const double *parameters; /* (vectors, n_parameters, 8) */
    double *states;           /* (vectors, n_states, 8) */
    int64_t *counting;        /* (vectors, 8) */
    const int64_t *checked;   /* elements of a row that have to be finite */
} folds_of_members;

/* Adds rows of one vector to the states: (rows + 1, elements, 8), `elements` of a row, the first row being the one
   before. A member's rows from the first one on that has a number that is not finite do not count. `counting` has -1 for
   members all of whose rows counted so far, else how many did; `ends` (8) how many of these rows each member has, more
   than `rows` if it goes on. */
OFFERED void folds_rows(const folds_of_members *block, int64_t vector, int64_t first, int64_t rows, int64_t elements,
                        const int64_t *ends, const double *chunk);
/* Number of a kernel, or -1; and its columns (elements), states and parameters. */
OFFERED int64_t folds_kernel(const char *name, int64_t sizes[3]);

#endif
