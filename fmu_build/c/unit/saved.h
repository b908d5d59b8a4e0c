/* Saved FMU states and their serialized form: versioned, without pointers, the same on every machine. */
#ifndef SAVED_H
#define SAVED_H

#include "instance.h"

INTERNAL_BEGIN
fmi_status save_state(fmi_instance *i, const char *function, void **saved);
fmi_status restore_state(fmi_instance *i, const char *function, const void *saved);
fmi_status free_state(fmi_instance *i, const char *function, void **saved);
fmi_status serialized_size(const fmi_instance *i, const char *function, const void *saved, size_t *size);
fmi_status serialize(const fmi_instance *i, const char *function, const void *saved, unsigned char bytes[],
                     size_t size);
fmi_status deserialize(const fmi_instance *i, const char *function, const unsigned char bytes[], size_t size,
                       void **saved);
INTERNAL_END

#endif
