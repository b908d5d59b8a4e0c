/* Saved FMU states, and their serial form: versioned, without pointers, the same on every machine. */
#ifndef SAVED_H
#define SAVED_H

#include "instance.h"

INTERNAL_BEGIN
status save_state(instance *i, const char *function, void **saved);
status restore_state(instance *i, const char *function, const void *saved);
status free_state(instance *i, const char *function, void **saved);
status serialized_size(const instance *i, const char *function, const void *saved, size_t *size);
status serialize(const instance *i, const char *function, const void *saved, unsigned char bytes[], size_t size);
status deserialize(const instance *i, const char *function, const unsigned char bytes[], size_t size, void **saved);
INTERNAL_END

#endif
