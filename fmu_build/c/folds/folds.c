#include "folds.h"

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
/* Rows of a vector at a time, after the row before: they stay in the cache. */
#define CHUNK 16

static mask least(mask a, mask b) { return ((a < b) & a) | (~(a < b) & b); }

/* An item of eight members: one for all, side by side, or one by one. */
static inline lanes item(const char *at, int64_t by_member, int64_t members, int is_flag)
{
    if (by_member == 0)
        return (lanes)(is_flag ? *(const uint8_t *)at : *(const double *)at);
    if (by_member == (int64_t)(is_flag ? sizeof(uint8_t) : sizeof(double)) && members >= WIDTH)
        return is_flag ? __builtin_convertvector(*(const flags *)at, lanes) : get((const double *)at);
    lanes x = (lanes)0.0;
    for (int64_t k = 0; k < members && k < WIDTH; k++, at += by_member)
        x[k] = is_flag ? *(const uint8_t *)at : *(const double *)at;
    return x;
}

/* Reads rows `from` to `to` - 1 of a vector into a chunk from an element on; from the reference what is there is taken. */
static void read_items(const items *source, int64_t size, int64_t vector, int64_t members, int64_t from, int64_t to,
                       lanes *into, int is_flag, int is_reference)
{
    const int64_t bytes = is_flag ? sizeof(uint8_t) : sizeof(double), first = vector * WIDTH;
    const char *of_row = (const char *)source->at + (from * source->row + first * source->member) * bytes;
    for (int64_t row = from; row < to; row++, of_row += source->row * bytes, into += MOST_COLUMNS)
        for (int64_t i = 0; i < size; i++) {
            lanes x = item(of_row + i * source->element * bytes, source->member * bytes, members - first, is_flag);
            into[i] = is_reference ? x - into[i] : x;
        }
}

/* Reads rows `from` to `to` - 1 of a vector into a chunk. */
static void read_rows(const rows_of_members *rows, int64_t vector, int64_t from, int64_t to,
                      lanes (*chunk)[MOST_COLUMNS])
{
    lanes *into = chunk[0];
    for (const column *c = rows->columns; c < rows->columns + rows->n_columns; into += c->size, c++) {
        read_items(&c->values, c->size, vector, rows->members, from, to, into, c->kind == FLAGS, 0);
        int64_t begin = from < 0 ? 0 : from; /* the reference begins with the block */
        if (c->kind == ERRORS)
            read_items(&c->reference, c->size, vector, rows->members, begin, to, into + (begin - from) * MOST_COLUMNS, 0, 1);
    }
}

/* Adds rows of a chunk, whose first one is that before, to a fold; `stop` has for each member how many of them count. */
static void add(const rows_of_members *block, const fold *f, int64_t vector, int64_t index, int64_t rows, mask stop,
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
static mask broken(const rows_of_members *block, const lanes row[])
{
    const int64_t n = block->n_checked, *at = block->checked;
    lanes a = (lanes)0.0, b = a, c = a, d = a;
    int64_t i = 0;
    for (; i + 4 <= n; i += 4) {
        a += row[at[i]] * 0;
        b += row[at[i + 1]] * 0;
        c += row[at[i + 2]] * 0;
        d += row[at[i + 3]] * 0;
    }
    for (; i < n; i++)
        a += row[at[i]] * 0;
    lanes sum = (a + b) + (c + d);
    return sum != sum;
}

/* Adds rows of a chunk to all folds. Returns how many of them count: those before one that is broken, `most` at the most. */
static mask add_rows(const rows_of_members *block, int64_t vector, int64_t index, int64_t rows, mask most,
                     const lanes *chunk, int64_t elements)
{
    for (int64_t row = 0; row < rows; row++) {
        mask ends = broken(block, chunk + (row + 1) * elements), at = (mask)(whole)row;
        most = (ends & least(most, at)) | (~ends & most);
    }
    for (const fold *f = block->folds; f < block->folds + block->n_folds; f++)
        add(block, f, vector, index, rows, most, chunk, elements);
    return most;
}

void folds_rows(const rows_of_members *block, int64_t vector, int64_t first, int64_t rows, int64_t elements,
                const int64_t *ends, const double *chunk)
{
    int64_t *counting = block->counting + vector * WIDTH;
    mask most = (mask)(whole)0;
    for (int64_t k = 0; k < WIDTH; k++)
        if (counting[k] < 0)
            most[k] = ends[k] < rows ? ends[k] : rows;
    if (!any(most))
        return;
    mask stop = add_rows(block, vector, first, rows, most, (const lanes *)chunk, elements);
    for (int64_t k = 0; k < WIDTH; k++)
        if (counting[k] < 0 && (stop[k] < rows || ends[k] <= rows))
            counting[k] = first + stop[k];
}

static void add_vector(const rows_of_members *block, int64_t vector)
{
    lanes chunk[CHUNK + 1][MOST_COLUMNS];
    int64_t *counting = block->counting + vector * WIDTH, members = block->members - vector * WIDTH;
    mask count = (mask)(whole)0;
    for (int64_t k = 0; k < members && k < WIDTH; k++)
        count[k] = counting[k];
    for (int64_t from = 0; from < block->rows && any(count > (whole)from); from += CHUNK) {
        int64_t rows = block->rows - from < CHUNK ? block->rows - from : CHUNK;
        int is_first = block->first + from == 0;
        read_rows(block, vector, from - !is_first, from + rows, chunk + is_first);
        mask left = least(count - (whole)from, (mask)(whole)rows);
        mask stop = add_rows(block, vector, block->first + from, rows, left, chunk[0], MOST_COLUMNS);
        count = (count & (stop == left)) | ((stop + (whole)from) & (stop != left));
    }
    for (int64_t k = 0; k < members && k < WIDTH; k++)
        counting[k] = count[k];
}

int64_t folds_add(const rows_of_members *block)
{
    int64_t elements = 0;
    for (int64_t i = 0; i < block->n_columns; i++)
        elements += block->columns[i].size;
    if (elements > MOST_COLUMNS)
        return -1;
    for (int64_t vector = 0; vector * WIDTH < block->members; vector++)
        add_vector(block, vector);
    return 0;
}

int64_t folds_kernel(const char *name, int64_t sizes[3])
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
