#include "saved.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Serial form, all numbers little-endian: magic (8 bytes), format, kind, mode, number of doubles (4 bytes each),
   layout of the variables (8), the doubles of component_state (8 each), checksum of all before (8). */
static const char MAGIC[8] = {'G', 'S', 'T', 'E', 'W', 'A', 'R', 'T'};

enum {
    FORMAT = 1,
    N_NUMBERS = sizeof(component_state) / sizeof(double),
    HEADER = 8 + 4 * 4 + 8,
    SERIAL_SIZE = HEADER + 8 * N_NUMBERS + 8
};

typedef struct {
    char magic[8];
    kind kind;
    mode mode;
    component_state state;
} saved_state;

static int is_saved_state(const instance *i, const char *function, const saved_state *saved)
{
    if (saved && memcmp(saved->magic, MAGIC, sizeof MAGIC) == 0)
        return 1;
    report(i, STATUS_ERROR, "%s: %s is no FMU state of this unit", function, saved ? "the pointer" : "a null pointer");
    return 0;
}

/* Puts a state where `saved` points, over an earlier one if there is one. */
static status keep(const instance *i, const char *function, void **saved, kind kind, mode mode,
                   const component_state *state)
{
    saved_state *s = *saved;
    if (s && !is_saved_state(i, function, s))
        return STATUS_ERROR;
    if (!s)
        s = malloc(sizeof *s);
    if (!s)
        return report(i, STATUS_ERROR, "%s: out of memory", function);
    *s = (saved_state){.kind = kind, .mode = mode, .state = *state};
    memcpy(s->magic, MAGIC, sizeof MAGIC);
    *saved = s;
    return STATUS_OK;
}

status save_state(instance *i, const char *function, void **saved)
{
    if (!is_allowed(i, function, CALL_FMU_STATE) || !has_array(i, function, saved, 1, "FMUState"))
        return STATUS_ERROR;
    return keep(i, function, saved, i->kind, i->mode, &i->component.s);
}

status restore_state(instance *i, const char *function, const void *saved)
{
    const saved_state *s = saved;
    if (!is_allowed(i, function, CALL_FMU_STATE) || !is_saved_state(i, function, s))
        return STATUS_ERROR;
    if (s->kind != i->kind)
        return report(i, STATUS_ERROR, "%s: the state is of %s; expected one of the instance's own kind", function,
                      s->kind == MODEL_EXCHANGE ? "Model Exchange" : "Co-Simulation");
    i->mode = s->mode;
    i->component.s = s->state;
    component_forget_results(&i->component);
    i->step_status = STATUS_OK;
    i->last_successful_time = s->state.time;
    return STATUS_OK;
}

status free_state(instance *i, const char *function, void **saved)
{
    if (!is_allowed(i, function, CALL_FMU_STATE))
        return STATUS_ERROR;
    if (!saved || !*saved)
        return STATUS_OK;
    saved_state *s = *saved;
    if (!is_saved_state(i, function, s))
        return STATUS_ERROR;
    s->magic[0] = 0;
    free(s);
    *saved = NULL;
    return STATUS_OK;
}

static void put(unsigned char **at, uint64_t value, int bytes)
{
    for (int b = 0; b < bytes; b++)
        *(*at)++ = (unsigned char)(value >> 8 * b);
}

static uint64_t take(const unsigned char **at, int bytes)
{
    uint64_t value = 0;
    for (int b = 0; b < bytes; b++)
        value |= (uint64_t) * (*at)++ << 8 * b;
    return value;
}

/* Fowler-Noll-Vo 1a, 64 bits */
static uint64_t checksum(const unsigned char *bytes, size_t n)
{
    uint64_t sum = 14695981039346656037u;
    for (size_t k = 0; k < n; k++)
        sum = (sum ^ bytes[k]) * 1099511628211u;
    return sum;
}

status serialized_size(const instance *i, const char *function, const void *saved, size_t *size)
{
    if (!is_allowed(i, function, CALL_FMU_STATE) || !is_saved_state(i, function, saved) ||
        !has_array(i, function, size, 1, "size"))
        return STATUS_ERROR;
    *size = SERIAL_SIZE;
    return STATUS_OK;
}

status serialize(const instance *i, const char *function, const void *saved, unsigned char bytes[], size_t size)
{
    const saved_state *s = saved;
    if (!is_allowed(i, function, CALL_FMU_STATE) || !is_saved_state(i, function, s) ||
        !has_array(i, function, bytes, 1, "serializedState"))
        return STATUS_ERROR;
    if (size < SERIAL_SIZE)
        return report(i, STATUS_ERROR, "%s: room for %lu bytes; expected %lu", function, (unsigned long)size,
                      (unsigned long)SERIAL_SIZE);
    double numbers[N_NUMBERS];
    memcpy(numbers, &s->state, sizeof numbers);
    unsigned char *at = bytes;
    memcpy(at, MAGIC, sizeof MAGIC);
    at += sizeof MAGIC;
    put(&at, FORMAT, 4);
    put(&at, s->kind, 4);
    put(&at, s->mode, 4);
    put(&at, N_NUMBERS, 4);
    put(&at, LAYOUT, 8);
    for (int k = 0; k < N_NUMBERS; k++) {
        uint64_t bits;
        memcpy(&bits, &numbers[k], sizeof bits);
        put(&at, bits, 8);
    }
    put(&at, checksum(bytes, SERIAL_SIZE - 8), 8);
    return STATUS_OK;
}

/* 1 if an instance can be in this state: what the checksum cannot tell of bytes made by somebody else. */
static int is_possible(kind kind, int mode, const component_state *s)
{
    int modes = kind == MODEL_EXCHANGE ? BEFORE_START | EVENT | CONTINUOUS | TERMINATED : BEFORE_START | STEP | TERMINATED;
    if ((kind != MODEL_EXCHANGE && kind != CO_SIMULATION) || !(mode & modes) || (mode & (mode - 1)))
        return 0;
    double numbers[N_NUMBERS];
    memcpy(numbers, s, sizeof numbers);
    for (int k = 0; k < N_NUMBERS; k++)
        if (isnan(numbers[k]) || (isinf(numbers[k]) && k != offsetof(component_state, stop_time) / sizeof(double)))
            return 0;
    return s->tolerance >= SMALLEST_TOLERANCE && s->tolerance <= LARGEST_TOLERANCE && s->internal_step >= 0 &&
           s->fixed_step_size >= 0;
}

status deserialize(const instance *i, const char *function, const unsigned char bytes[], size_t size, void **saved)
{
    if (!is_allowed(i, function, CALL_FMU_STATE) || !has_array(i, function, bytes, size, "serializedState") ||
        !has_array(i, function, saved, 1, "FMUState"))
        return STATUS_ERROR;
    if (size < HEADER || memcmp(bytes, MAGIC, sizeof MAGIC) != 0)
        return report(i, STATUS_ERROR, "%s: %lu bytes that are no state of this unit", function, (unsigned long)size);
    const unsigned char *at = bytes + sizeof MAGIC;
    unsigned long format = (unsigned long)take(&at, 4);
    unsigned long kind_number = (unsigned long)take(&at, 4), mode_number = (unsigned long)take(&at, 4);
    unsigned long n = (unsigned long)take(&at, 4);
    uint64_t layout = take(&at, 8);
    if (format != FORMAT || layout != LAYOUT || n != N_NUMBERS)
        return report(i, STATUS_ERROR,
                      "%s: a state of another version of this unit (format %lu, %lu numbers); expected format %d, %d "
                      "numbers, and the same variables",
                      function, format, n, FORMAT, N_NUMBERS);
    if (size != SERIAL_SIZE)
        return report(i, STATUS_ERROR, "%s: %lu bytes; expected %lu", function, (unsigned long)size,
                      (unsigned long)SERIAL_SIZE);
    double numbers[N_NUMBERS];
    for (int k = 0; k < N_NUMBERS; k++) {
        uint64_t bits = take(&at, 8);
        memcpy(&numbers[k], &bits, sizeof bits);
    }
    component_state state;
    memcpy(&state, numbers, sizeof state);
    if (take(&at, 8) != checksum(bytes, SERIAL_SIZE - 8) || !is_possible((kind)kind_number, (int)mode_number, &state))
        return report(i, STATUS_ERROR, "%s: the bytes are damaged (wrong checksum or impossible values)", function);
    void *made = NULL; /* unlike for saving, the standards do not call the pointer an input */
    status kept = keep(i, function, &made, (kind)kind_number, (mode)mode_number, &state);
    if (kept == STATUS_OK)
        *saved = made;
    return kept;
}
