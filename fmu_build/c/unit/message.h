/* Error messages: value found, value expected, remedy. */
#ifndef MESSAGE_H
#define MESSAGE_H

#include <stdarg.h>

#include "internal.h"

#define MESSAGE_SIZE 400

INTERNAL_BEGIN
/* Like snprintf into MESSAGE_SIZE characters of UTF-8, but without '%', in case an importer uses it as a format. */
void write_message(char message[MESSAGE_SIZE], const char *format, ...);
void write_message_of(char message[MESSAGE_SIZE], const char *format, va_list arguments);
INTERNAL_END

#endif
