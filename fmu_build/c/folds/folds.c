#include "folds.h"

#include "elementary.h"

/* the bits of NumPy, which takes one operation after the other */
#pragma STDC FP_CONTRACT OFF
#pragma clang fp reciprocal(off)

/* as NumPy's: NaN if one of the two is */
static inline lanes smaller(lanes a, lanes b)
{
    return choose((b < a) | (b != b), b, a);
}

static inline lanes larger(lanes a, lanes b)
{
    return choose((b > a) | (b != b), b, a);
}

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

static mask least(mask a, mask b)
{
    return ((a < b) & a) | (~(a < b) & b);
}

/* How the items of eight members are found: side by side, one for all, or one by one. */
enum { TOGETHER, COMMON, SINGLY };
/* What becomes of them in a row: they are its numbers, or its numbers are taken from them. */
enum { NUMBERS_OF, FLAGS_OF, MINUS };

/* Reads items of rows of a vector into the elements of a chunk from `place` on. Constant `how` and `what` are no
   branches in the loop. */
static inline __attribute__((always_inline)) void read_items(const items *given, int64_t size, int64_t first,
                                                             int64_t members, int64_t from, int64_t to, int64_t place,
                                                             lanes (*chunk)[MOST_COLUMNS], int how, int what)
{
    const int64_t bytes = what == FLAGS_OF ? 1 : sizeof(double), by_row = given->row * bytes;
    const int64_t by_element = given->element * bytes, by_member = given->member * bytes;
    const char *of_row = (const char *)given->at + from * by_row + first * by_member;
    lanes *into = chunk[0] + place;
    for (int64_t row = from; row < to; row++, of_row += by_row, into += MOST_COLUMNS) {
        const char *at = of_row;
        for (int64_t i = 0; i < size; i++, at += by_element) {
            lanes found = (lanes)0.0;
            if (how == TOGETHER) {
                found = what == FLAGS_OF ? __builtin_convertvector(*(const flags *)at, lanes)
                                         : (lanes) * (const anywhere *)at;
            } else if (how == COMMON) {
                found = (lanes)(what == FLAGS_OF ? *(const unsigned char *)at : *(const double *)at);
            } else {
                for (int64_t k = 0; k < members && k < WIDTH; k++) {
                    const char *of = at + k * by_member;
                    found[k] = what == FLAGS_OF ? *(const unsigned char *)of : *(const double *)of;
                }
            }
            into[i] = what == MINUS ? found - into[i] : found;
        }
    }
}

static void read_as(const items *given, int64_t size, int64_t vector, int64_t members, int64_t from, int64_t to,
                    int64_t place, lanes (*chunk)[MOST_COLUMNS], int what)
{
    int64_t first = vector * WIDTH, left = members - first;
    int how = given->member == 0 ? COMMON : given->member == 1 && left >= WIDTH ? TOGETHER : SINGLY;
#define READ(how, what) read_items(given, size, first, left, from, to, place, chunk, how, what)
#define READ_ANY(what) \
    (how == TOGETHER ? READ(TOGETHER, what) : how == COMMON ? READ(COMMON, what) : READ(SINGLY, what))
    if (what == FLAGS_OF)
        READ_ANY(FLAGS_OF);
    else if (what == MINUS)
        READ_ANY(MINUS);
    else
        READ_ANY(NUMBERS_OF);
}

/* Reads rows `from` to `to` - 1 of a vector into a chunk. */
static void read_rows(const rows_of_members *of, int64_t vector, int64_t from, int64_t to, lanes (*chunk)[MOST_COLUMNS])
{
    int64_t place = 0;
    for (const column *c = of->columns; c < of->columns + of->n_columns; place += c->size, c++) {
        read_as(&c->values, c->size, vector, of->members, from, to, place, chunk,
                c->kind == FLAGS ? FLAGS_OF : NUMBERS_OF);
        if (c->kind == ERRORS) { /* whose reference begins with the block */
            int64_t begin = from < 0 ? 0 : from;
            read_as(&c->reference, c->size, vector, of->members, begin, to, place, chunk + (begin - from), MINUS);
        }
    }
}

/* Adds rows of a chunk, whose first one is that before, to a fold; `stop` has for each member how many of them count. */
static void add(const rows_of_members *of, const fold *f, int64_t vector, int64_t index, int64_t rows, mask stop,
                const lanes *chunk, int64_t elements)
{
    const kernel *k = &KERNELS[f->kernel];
    const double *given = of->parameters + (vector * of->n_parameters + f->parameter) * WIDTH;
    double *kept = of->states + (vector * of->n_states + f->state) * WIDTH;
    lanes parameters[MOST_PARAMETERS], one[MOST_STATES], other[MOST_STATES], *state = one, *next = other;
    for (int64_t i = 0; i < k->parameters; i++)
        parameters[i] = ((const anywhere *)given)[i];
    for (int64_t i = 0; i < k->states; i++)
        state[i] = ((const anywhere *)kept)[i];
    for (int64_t row = 0; row < rows; row++) {
        const lanes *here = chunk + (row + 1) * elements, *before = index + row ? here - elements : here;
        lanes at = (lanes)(double)(index + row), *swap = state;
        k->step(here, before, f->places, &at, parameters, state, next);
        state = next;
        next = swap;
        mask ends = stop == (whole)(row + 1);
        if (any(ends))
            for (int64_t i = 0; i < k->states; i++)
                ((anywhere *)kept)[i] = choose(ends, state[i], ((const anywhere *)kept)[i]);
    }
}

/* Members with an element of a row that has to be finite and is not. */
static mask broken(const rows_of_members *of, const lanes row[])
{
    const int64_t n = of->n_checked, *at = of->checked;
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

/* How many of the rows of a chunk count: those before one that is broken, `most` at the most. */
static mask counted(const rows_of_members *of, int64_t rows, mask most, const lanes *chunk, int64_t elements)
{
    for (int64_t row = 0; row < rows; row++) {
        mask ends = broken(of, chunk + (row + 1) * elements), here = (mask)(whole)row;
        most = (ends & least(most, here)) | (~ends & most);
    }
    return most;
}

void folds_rows(const rows_of_members *of, int64_t vector, int64_t first, int64_t rows, int64_t elements,
                const int64_t *ends, const double *chunk)
{
    int64_t *counting = of->counting + vector * WIDTH;
    mask most = (mask)(whole)0;
    for (int64_t k = 0; k < WIDTH; k++)
        if (counting[k] < 0)
            most[k] = ends[k] < rows ? ends[k] : rows;
    if (!any(most))
        return;
    mask stop = counted(of, rows, most, (const lanes *)chunk, elements);
    for (const fold *f = of->folds; f < of->folds + of->n_folds; f++)
        add(of, f, vector, first, rows, stop, (const lanes *)chunk, elements);
    for (int64_t k = 0; k < WIDTH; k++)
        if (counting[k] < 0 && (stop[k] < rows || ends[k] <= rows))
            counting[k] = first + stop[k];
}

static void add_vector(const rows_of_members *of, int64_t vector)
{
    lanes chunk[CHUNK + 1][MOST_COLUMNS];
    int64_t *counting = of->counting + vector * WIDTH, members = of->members - vector * WIDTH;
    mask count = (mask)(whole)0;
    for (int64_t k = 0; k < members && k < WIDTH; k++)
        count[k] = counting[k];
    for (int64_t from = 0; from < of->rows && any(count > (whole)from); from += CHUNK) {
        int64_t rows = of->rows - from < CHUNK ? of->rows - from : CHUNK;
        int is_first = of->first + from == 0;
        read_rows(of, vector, from - !is_first, from + rows, chunk + is_first);
        mask left = least(count - (whole)from, (mask)(whole)rows);
        mask stop = counted(of, rows, left, chunk[0], MOST_COLUMNS);
        count = (count & (stop == left)) | ((stop + (whole)from) & (stop != left));
        for (const fold *f = of->folds; f < of->folds + of->n_folds; f++)
            add(of, f, vector, of->first + from, rows, stop, chunk[0], MOST_COLUMNS);
    }
    for (int64_t k = 0; k < members && k < WIDTH; k++)
        counting[k] = count[k];
}

int64_t folds_add(const rows_of_members *of)
{
    int64_t elements = 0;
    for (int64_t i = 0; i < of->n_columns; i++)
        elements += of->columns[i].size;
    if (elements > MOST_COLUMNS)
        return -1;
    for (int64_t vector = 0; vector * WIDTH < of->members; vector++)
        add_vector(of, vector);
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
