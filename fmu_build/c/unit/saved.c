#include "instance.h"

#include <stdlib.h>
#include <string.h>

/* Serial form, all numbers little-endian: magic (8 bytes), format, kind, mode, number of doubles (4 bytes each),
   layout of the variables (8), the component's numbers (8 each), checksum of all before (8). */
static const char MAGIC[8] = {'G', 'S', 'T', 'E', 'W', 'A', 'R', 'T'};

enum { FORMAT = 1, HEADER = 8 + 4 * 4 + 8 };

typedef struct {
    char magic[8];
    fmi_kind kind;
    fmi_mode mode;
    double numbers[]; /* N_SAVED of them */
} saved_state;

static size_t serial_size(void) { return HEADER + 8 * N_SAVED + 8; }

static int is_saved_state(const fmi_instance *i, const char *function, const saved_state *saved)
{
    if (saved && memcmp(saved->magic, MAGIC, sizeof MAGIC) == 0)
        return 1;
    report(i, STATUS_ERROR, "%s: %s is not an FMU state of this unit", function,
           saved ? "the pointer" : "a null pointer");
    return 0;
}

static saved_state *new_saved_state(void)
{
    saved_state *s = malloc(sizeof *s + N_SAVED * sizeof s->numbers[0]);
    if (s)
        memcpy(s->magic, MAGIC, sizeof MAGIC);
    return s;
}

/* Overwrites the importer's state if there is one. */
fmi_status save_state(fmi_instance *i, const char *function, void **saved)
{
    if (!is_allowed(i, function, CALL_FMU_STATE) || !has_array(i, function, saved, 1, "FMUState"))
        return STATUS_ERROR;
    saved_state *s = *saved;
    if (s && !is_saved_state(i, function, s))
        return STATUS_ERROR;
    if (!s)
        s = new_saved_state();
    if (!s)
        return report(i, STATUS_ERROR, "%s: out of memory", function);
    s->kind = i->kind;
    s->mode = i->mode;
    component_save(i->core, s->numbers);
    *saved = s;
    return STATUS_OK;
}

fmi_status restore_state(fmi_instance *i, const char *function, const void *saved)
{
    const saved_state *s = saved;
    if (!is_allowed(i, function, CALL_FMU_STATE) || !is_saved_state(i, function, s))
        return STATUS_ERROR;
    if (s->kind != i->kind)
        return report(i, STATUS_ERROR, "%s: the state is from %s; expected one of the instance's own kind", function,
                      name_of_kind(s->kind));
    i->mode = s->mode;
    component_restore(i->core, s->numbers);
    i->step_status = STATUS_OK;
    i->last_successful_time = component_time(i->core);
    return STATUS_OK;
}

fmi_status free_state(fmi_instance *i, const char *function, void **saved)
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

fmi_status serialized_size(const fmi_instance *i, const char *function, const void *saved, size_t *size)
{
    if (!is_allowed(i, function, CALL_FMU_STATE) || !is_saved_state(i, function, saved) ||
        !has_array(i, function, size, 1, "size"))
        return STATUS_ERROR;
    *size = serial_size();
    return STATUS_OK;
}

fmi_status serialize(const fmi_instance *i, const char *function, const void *saved, unsigned char bytes[],
                     size_t size)
{
    const saved_state *s = saved;
    if (!is_allowed(i, function, CALL_FMU_STATE) || !is_saved_state(i, function, s) ||
        !has_array(i, function, bytes, 1, "serializedState"))
        return STATUS_ERROR;
    if (size < serial_size())
        return report(i, STATUS_ERROR, "%s: buffer of %lu bytes; expected %lu", function, (unsigned long)size,
                      (unsigned long)serial_size());
    unsigned char *at = bytes;
    memcpy(at, MAGIC, sizeof MAGIC);
    at += sizeof MAGIC;
    const uint64_t header[] = {FORMAT, s->kind, s->mode, N_SAVED};
    for (int k = 0; k < 4; k++)
        put(&at, header[k], 4);
    put(&at, LAYOUT, 8);
    for (size_t k = 0; k < N_SAVED; k++) {
        uint64_t bits;
        memcpy(&bits, &s->numbers[k], sizeof bits);
        put(&at, bits, 8);
    }
    put(&at, checksum(bytes, (size_t)(at - bytes)), 8);
    return STATUS_OK;
}

/* 1 if an instance can be in this state: a valid checksum does not guarantee it for bytes from another source. */
static int is_possible(const saved_state *s)
{
    int modes = BEFORE_START | TERMINATED;
    modes |= s->kind == MODEL_EXCHANGE ? EVENT | CONTINUOUS : STEP;
    int mode = (int)s->mode;
    int is_offered = s->kind == CO_SIMULATION || (s->kind == MODEL_EXCHANGE && N_STATES > 0);
    if (!is_offered || !(mode & modes) || (mode & (mode - 1)))
        return 0;
    return component_can_restore(s->numbers);
}

fmi_status deserialize(const fmi_instance *i, const char *function, const unsigned char bytes[], size_t size,
                       void **saved)
{
    if (!is_allowed(i, function, CALL_FMU_STATE) || !has_array(i, function, bytes, size, "serializedState") ||
        !has_array(i, function, saved, 1, "FMUState"))
        return STATUS_ERROR;
    if (size < HEADER || memcmp(bytes, MAGIC, sizeof MAGIC) != 0)
        return report(i, STATUS_ERROR, "%s: %lu bytes that are not a state of this unit", function,
                      (unsigned long)size);
    const unsigned char *at = bytes + sizeof MAGIC;
    unsigned long format = (unsigned long)take(&at, 4), kind = (unsigned long)take(&at, 4);
    unsigned long mode = (unsigned long)take(&at, 4), n = (unsigned long)take(&at, 4);
    uint64_t layout = take(&at, 8);
    if (format != FORMAT || layout != LAYOUT || n != N_SAVED)
        return report(i, STATUS_ERROR,
                      "%s: the state is from another version of this unit (format %lu, %lu numbers); expected format "
                      "%d, %lu numbers and the same variables",
                      function, format, n, FORMAT, (unsigned long)N_SAVED);
    if (size != serial_size())
        return report(i, STATUS_ERROR, "%s: %lu bytes; expected %lu", function, (unsigned long)size,
                      (unsigned long)serial_size());
    /* unlike when saving, *saved is an output only and is not read */
    saved_state *s = new_saved_state();
    if (!s)
        return report(i, STATUS_ERROR, "%s: out of memory", function);
    s->kind = (fmi_kind)kind;
    s->mode = (fmi_mode)mode;
    for (size_t k = 0; k < N_SAVED; k++) {
        uint64_t bits = take(&at, 8);
        memcpy(&s->numbers[k], &bits, sizeof bits);
    }
    uint64_t sum = checksum(bytes, (size_t)(at - bytes));
    if (take(&at, 8) != sum || !is_possible(s)) {
        free(s);
        return report(i, STATUS_ERROR, "%s: the bytes are damaged (wrong checksum or impossible values)", function);
    }
    *saved = s;
    return STATUS_OK;
}
