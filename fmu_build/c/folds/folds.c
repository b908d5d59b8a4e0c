/* Folds rows of many members, eight per vector. No state, no allocation; calls for
   different members can run in parallel. A member's bits depend on its own numbers alone: not on the number of members,
   its place, or the size of blocks. */
#include "elementary.h"

/* the bits of NumPy, which takes one operation after the other */
#pragma STDC FP_CONTRACT OFF
#pragma clang fp reciprocal(off)

/* as NumPy's: NaN if one of the two is */
static inline lanes smaller(lanes a, lanes b) { return choose((b < a) | (b != b), b, a); }
static inline lanes larger(lanes a, lanes b) { return choose((b > a) | (b != b), b, a); }

#undef fmin
#undef fmax
#define fmin(x, y) smaller(x, y)
#define fmax(x, y) larger(x, y)

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

typedef struct {
    const char *name;
    int64_t columns, states, parameters;
    /* the states after a row, from those before; `places` are those of the columns in the row and the row before it */
    void (*step)(const lanes row[], const lanes before[], const int64_t places[], const lanes index[],
                 const lanes parameters[], const lanes state[], lanes next[]);
} kernel;

/* the generated kernels, as KERNELS, and sizes */
#include "fold_kernels.h"

#define N_KERNELS (int64_t)(sizeof KERNELS / sizeof KERNELS[0])

static mask least(mask a, mask b) { return ((a < b) & a) | (~(a < b) & b); }

/* Adds rows of a chunk, whose first one is that before, to a fold; `stop` has for each member how many of them count. */
static void add(const folds_of_members *block, const fold *f, int64_t vector, int64_t index, int64_t rows, mask stop,
                const lanes *chunk, int64_t elements)
{
    const kernel *k = &KERNELS[f->kernel];
    const double *values = block->parameters + (vector * block->n_parameters + f->parameter) * WIDTH;
    double *kept = block->states + (vector * block->n_states + f->state) * WIDTH;
    lanes parameters[MOST_PARAMETERS], one[MOST_STATES], other[MOST_STATES], *state = one, *next = other;
    for (int64_t i = 0; i < k->parameters; i++)
        parameters[i] = get(values + i * WIDTH);
    for (int64_t i = 0; i < k->states; i++)
        state[i] = get(kept + i * WIDTH);
    for (int64_t row = 0; row < rows; row++) {
        const lanes *now = chunk + (row + 1) * elements, *before = index + row ? now - elements : now;
        lanes at = (lanes)(double)(index + row), *swap = state;
        k->step(now, before, f->places, &at, parameters, state, next);
        state = next;
        next = swap;
        mask ends = stop == (whole)(row + 1);
        if (any(ends))
            for (int64_t i = 0; i < k->states; i++)
                put(kept + i * WIDTH, choose(ends, state[i], get(kept + i * WIDTH)));
    }
}

/* Members with an element of a row that has to be finite and is not. */
static mask broken(const folds_of_members *block, const lanes row[])
{
    mask bad = (mask)(whole)0;
    for (int64_t i = 0; i < block->n_checked; i++)
        bad |= row[block->checked[i]] * 0 != 0;
    return bad;
}

/* Adds rows of one vector to the states: (rows + 1, elements, 8), `elements` of a row, the first row being the one
   before. A member's rows from the first one on that has a number that is not finite do not count. `counting` has -1 for
   members all of whose rows counted so far, else how many did; `ends` (8) how many of these rows each member has, more
   than `rows` if it goes on. */
OFFERED void folds_rows(const folds_of_members *block, int64_t vector, int64_t first, int64_t rows, int64_t elements,
                const int64_t *ends, const double *chunk)
{
    int64_t *counting = block->counting + vector * WIDTH;
    const lanes *all = (const lanes *)chunk;
    mask stop = (mask)(whole)0; /* how many rows count: those before one that is broken */
    for (int64_t k = 0; k < WIDTH; k++)
        if (counting[k] < 0)
            stop[k] = ends[k] < rows ? ends[k] : rows;
    if (!any(stop))
        return;
    for (int64_t row = 0; row < rows; row++) {
        mask breaks = broken(block, all + (row + 1) * elements), at = (mask)(whole)row;
        stop = (breaks & least(stop, at)) | (~breaks & stop);
    }
    for (const fold *f = block->folds; f < block->folds + block->n_folds; f++)
        add(block, f, vector, first, rows, stop, all, elements);
    for (int64_t k = 0; k < WIDTH; k++)
        if (counting[k] < 0 && (stop[k] < rows || ends[k] <= rows))
            counting[k] = first + stop[k];
}

/* Number of a kernel, or -1; and its columns (elements), states and parameters. */
OFFERED int64_t folds_kernel(const char *name, int64_t sizes[3])
{
    for (int64_t i = 0; i < N_KERNELS; i++)
        if (!strcmp(KERNELS[i].name, name)) {
            sizes[0] = KERNELS[i].columns;
            sizes[1] = KERNELS[i].states;
            sizes[2] = KERNELS[i].parameters;
            return i;
        }
    return -1;
}
