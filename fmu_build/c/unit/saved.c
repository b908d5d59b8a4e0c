#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A saved state, in memory and in serial form: there the checksum of all before follows the numbers. All targets are
   little-endian; the others refuse a state of these by its format. */
static const char MAGIC[8] = {'G', 'S', 'T', 'E', 'W', 'A', 'R', 'T'};

enum { FORMAT = 1 };

typedef struct {
    char magic[8];
    uint32_t format, kind, mode, n;
    uint64_t layout;  /* of the variables */
    double numbers[]; /* n = N_SAVED of the component */
} saved_state;

static size_t state_size(void) { return sizeof(saved_state) + N_SAVED * sizeof(double); }
static size_t serial_size(void) { return state_size() + sizeof(uint64_t); }

static int is_saved_state(fmi_instance *i, const saved_state *saved)
{
    if (!saved || memcmp(saved->magic, MAGIC, sizeof MAGIC) != 0)
        return report(i, STATUS_ERROR, "%s is not an FMU state of this unit",
                      saved ? "the pointer" : "a null pointer"), 0;
    return 1;
}

/* Overwrites the importer's state if there is one. */
fmi_status save_state(fmi_instance *i, void **saved)
{
    if (!is_allowed(i, CALL_FMU_STATE) || !has_array(i, saved, 1, "FMUState"))
        return STATUS_ERROR;
    saved_state *s = *saved;
    if (s && !is_saved_state(i, s))
        return STATUS_ERROR;
    if (!s)
        s = malloc(state_size());
    if (!s)
        return report(i, STATUS_ERROR, "out of memory");
    *s = (saved_state){.format = FORMAT, .kind = i->kind, .mode = i->mode, .n = (uint32_t)N_SAVED, .layout = LAYOUT};
    memcpy(s->magic, MAGIC, sizeof MAGIC);
    memcpy(s->numbers, i->core, N_SAVED * sizeof(double));
    *saved = s;
    return STATUS_OK;
}

fmi_status restore_state(fmi_instance *i, const void *saved)
{
    const saved_state *s = saved;
    if (!is_allowed(i, CALL_FMU_STATE) || !is_saved_state(i, s))
        return STATUS_ERROR;
    if (s->kind != (uint32_t)i->kind)
        return report(i, STATUS_ERROR, "the state is from %s; expected one of the instance's own kind",
                      name_of_kind(s->kind));
    i->mode = (fmi_mode)s->mode;
    memcpy(i->core, s->numbers, N_SAVED * sizeof(double));
    component_forget(i->core);
    i->step_status = STATUS_OK;
    component_get(i->core, TIME, &i->last_successful_time);
    return STATUS_OK;
}

fmi_status free_state(fmi_instance *i, void **saved)
{
    if (!is_allowed(i, CALL_FMU_STATE))
        return STATUS_ERROR;
    if (!saved || !*saved)
        return STATUS_OK;
    saved_state *s = *saved;
    if (!is_saved_state(i, s))
        return STATUS_ERROR;
    s->magic[0] = 0;
    free(s);
    *saved = NULL;
    return STATUS_OK;
}

/* Fowler-Noll-Vo 1a, 64 bits */
static uint64_t checksum(const unsigned char *bytes, size_t n)
{
    uint64_t sum = 14695981039346656037u;
    for (size_t k = 0; k < n; k++)
        sum = (sum ^ bytes[k]) * 1099511628211u;
    return sum;
}

fmi_status serialized_size(fmi_instance *i, const void *saved, size_t *size)
{
    if (!is_allowed(i, CALL_FMU_STATE) || !is_saved_state(i, saved) || !has_array(i, size, 1, "size"))
        return STATUS_ERROR;
    *size = serial_size();
    return STATUS_OK;
}

fmi_status serialize(fmi_instance *i, const void *saved, unsigned char bytes[], size_t size)
{
    const saved_state *s = saved;
    if (!is_allowed(i, CALL_FMU_STATE) || !is_saved_state(i, s) || !has_array(i, bytes, 1, "serializedState"))
        return STATUS_ERROR;
    if (size < serial_size())
        return report(i, STATUS_ERROR, "buffer of %lu bytes; expected %lu", (unsigned long)size,
                      (unsigned long)serial_size());
    memcpy(bytes, s, state_size());
    uint64_t sum = checksum(bytes, state_size());
    memcpy(bytes + state_size(), &sum, sizeof sum);
    return STATUS_OK;
}

/* 1 if an instance can be in this state: a valid checksum does not guarantee it for bytes from another source. */
static int is_possible(const saved_state *s)
{
    int mode = (int)s->mode, modes = BEFORE_START | TERMINATED | (s->kind == CO_SIMULATION ? STEP : EVENT | CONTINUOUS);
    int is_offered = s->kind == CO_SIMULATION || (s->kind == MODEL_EXCHANGE && N_STATES > 0);
    for (size_t k = 0; k < N_SAVED; k++)
        if (k == STOP_TIME ? isnan(s->numbers[k]) : !isfinite(s->numbers[k]))
            return 0;
    return is_offered && mode & modes && !(mode & (mode - 1)) && component_can_restore(s->numbers);
}

fmi_status deserialize(fmi_instance *i, const unsigned char bytes[], size_t size, void **saved)
{
    if (!is_allowed(i, CALL_FMU_STATE) || !has_array(i, bytes, size, "serializedState") ||
        !has_array(i, saved, 1, "FMUState"))
        return STATUS_ERROR;
    saved_state header;
    if (size < sizeof header || memcmp(bytes, MAGIC, sizeof MAGIC) != 0)
        return report(i, STATUS_ERROR, "%lu bytes that are not a state of this unit", (unsigned long)size);
    memcpy(&header, bytes, sizeof header);
    if (header.format != FORMAT || header.layout != LAYOUT || header.n != N_SAVED)
        return report(i, STATUS_ERROR, "the state is from another version of this unit (format %lu, %lu numbers); "
                      "expected format %d, %lu numbers and the same variables", (unsigned long)header.format,
                      (unsigned long)header.n, FORMAT, (unsigned long)N_SAVED);
    if (size != serial_size())
        return report(i, STATUS_ERROR, "%lu bytes; expected %lu", (unsigned long)size, (unsigned long)serial_size());
    /* unlike when saving, *saved is an output only and is not read */
    saved_state *s = malloc(state_size());
    if (!s)
        return report(i, STATUS_ERROR, "out of memory");
    memcpy(s, bytes, state_size());
    uint64_t sum;
    memcpy(&sum, bytes + state_size(), sizeof sum);
    if (sum != checksum(bytes, state_size()) || !is_possible(s)) {
        free(s);
        return report(i, STATUS_ERROR, "the bytes are damaged (wrong checksum or impossible values)");
    }
    *saved = s;
    return STATUS_OK;
}
