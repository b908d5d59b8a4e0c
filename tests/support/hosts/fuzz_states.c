/* Actions on saved FMU states: right, damaged, forged, of other instances, versions and kinds. */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"

enum { N_SAVED = 4 };

/* Of all instances of the sequence: a state knows no owner. */
static struct {
    void *state;
    fmi_kind kind;
    fmi_mode mode;
    double time;
} saved[N_SAVED];

static struct {
    unsigned char bytes[MOST_BYTES];
    size_t size;
} blob;

/* One that holds a state, mostly. */
static size_t filled_place(void)
{
    size_t k = below(N_SAVED);
    for (int tries = chance(0.9) ? N_SAVED : 0; tries > 0 && !saved[k].state; tries--)
        k = (k + 1) % N_SAVED;
    return k;
}

void forget_saved_states(host *h)
{
    for (int k = 0; k < N_SAVED; k++)
        if (saved[k].state) {
            CALL_EITHER(h, fmi2FreeFMUstate, fmi3FreeFMUState, h->unit, &saved[k].state);
            require(saved[k].state == NULL, "a freed state leaves a null pointer");
        }
    memset(&blob, 0, sizeof blob); /* a sequence is the same when it runs alone */
}

static void save(host *h)
{
    size_t k = below(N_SAVED);
    if (CALL_EITHER(h, fmi2GetFMUstate, fmi3GetFMUState, unit(h), due(&saved[k].state)) != OK)
        return;
    require(saved[k].state != NULL, "there is a state after it was asked for");
    saved[k].kind = h->kind;
    saved[k].mode = h->mode;
    saved[k].time = h->time;
}

static void restore(host *h)
{
    size_t k = filled_place();
    void *no_state = exactly(16); /* aligned as a state is */
    void *state = chance(0.02) ? no_state : saved[k].state;
    if (CALL_EITHER(h, fmi2SetFMUstate, fmi3SetFMUState, unit(h), state) != OK)
        return;
    require(state == saved[k].state && saved[k].kind == h->kind, "only states of the own kind can be restored");
    require(h->time == saved[k].time, "the time is that of the state");
    h->mode = saved[k].mode;
}

/* Twice, the second time through the null pointer that is left. */
static void release(host *h)
{
    size_t k = filled_place();
    int status = CALL_EITHER(h, fmi2FreeFMUstate, fmi3FreeFMUState, unit(h), &saved[k].state);
    if (status == OK) {
        require(saved[k].state == NULL, "a freed state leaves a null pointer");
        CALL_EITHER(h, fmi2FreeFMUstate, fmi3FreeFMUState, unit(h), &saved[k].state);
    }
}

static void release_nothing(host *h)
{
    char *no_state = exactly(16);
    void *pointer = no_state;
    CALL_EITHER(h, fmi2FreeFMUstate, fmi3FreeFMUState, unit(h), chance(0.5) ? NULL : &pointer);
    require(pointer == no_state, "what is no state is left alone");
}

static void serialize(host *h)
{
    size_t k = filled_place(), size = 0;
    if (CALL_EITHER(h, fmi2SerializedFMUstateSize, fmi3SerializedFMUStateSize, unit(h), saved[k].state,
                    due(&size)) != OK)
        return;
    require(size > 0 && size <= MOST_BYTES, "the size is that of a state");
    size_t room = chance(0.9) ? size : below(2 * size);
    void *bytes = exactly(room);
    int status = CALL_EITHER(h, fmi2SerializeFMUstate, fmi3SerializeFMUState, unit(h), saved[k].state, due(bytes),
                             room);
    if (status != OK)
        return;
    require(room >= size, "a state is not written into less room than it needs");
    memcpy(blob.bytes, bytes, size);
    blob.size = size;
}

/* The serial form is that of fmu_build/c/unit/saved.c: header of 32 bytes with kind and mode, numbers, checksum. */
enum { HEADER = 32, KIND_AT = 12, MODE_AT = 16 };

/* The state of another program that knows the checksum, or of a later version with other limits. */
static void forge(unsigned char *bytes, size_t size)
{
    for (size_t k = 1 + below(3); k > 0; k--) {
        double number = chance(0.5) ? hostile_number() : number_of_any_size();
        memcpy(bytes + HEADER + 8 * below((size - HEADER) / 8 - 1), &number, sizeof number);
    }
    if (chance(0.1))
        bytes[MODE_AT] = (unsigned char)random_bits();
    uint64_t sum = UINT64_C(14695981039346656037); /* Fowler-Noll-Vo 1a */
    for (size_t k = 0; k < size - 8; k++)
        sum = (sum ^ bytes[k]) * UINT64_C(1099511628211);
    for (int k = 0; k < 8; k++)
        bytes[size - 8 + (size_t)k] = (unsigned char)(sum >> 8 * k);
}

static void deserialize(host *h)
{
    size_t k = below(N_SAVED), size = blob.size ? blob.size : below(MOST_BYTES);
    if (saved[k].state)
        return; /* a new state is made, and the old one would be lost */
    unsigned char changed[MOST_BYTES];
    memcpy(changed, blob.bytes, MOST_BYTES);
    int is_whole = blob.size > 0;
    double damage = fraction();
    if (damage < 0.2) { /* a wrong length */
        size = below(MOST_BYTES);
        is_whole = size == blob.size;
    } else if (damage < 0.4 && size > 0) { /* flipped bits */
        changed[below(size)] ^= (unsigned char)(1u << below(8));
        is_whole = 0;
    } else if (damage < 0.5) { /* random behind the right beginning */
        for (size_t at = 8; at < size; at++)
            changed[at] = (unsigned char)random_bits();
        is_whole = 0;
    } else if (damage < 0.6 && is_whole) {
        forge(changed, size);
        is_whole = 2;
    }
    unsigned char *bytes = exactly(size);
    memcpy(bytes, changed, size);
    void *made = (void *)1; /* what lies there before is nobody's business */
    if (CALL_EITHER(h, fmi2DeSerializeFMUstate, fmi3DeserializeFMUState, unit(h), due(bytes), size, due(&made)) != OK)
        return;
    saved[k].state = made;
    require(is_whole, "damaged bytes are refused");
    saved[k].kind = (fmi_kind)changed[KIND_AT];
    saved[k].mode = (fmi_mode)changed[MODE_AT];
    memcpy(&saved[k].time, changed + HEADER, sizeof(double));
}

const action SAVED_STATE_ACTIONS[] = {save,      save,        save,        restore,         restore, restore,
                                      serialize, serialize,   deserialize, release_nothing, release, NULL};
