/* Text that says what was wrong: value found, value expected, remedy. */
#ifndef MESSAGE_H
#define MESSAGE_H

#include <stdarg.h>

#include "internal.h"

#define MESSAGE_SIZE 400

INTERNAL_BEGIN
/* As snprintf into MESSAGE_SIZE characters of UTF-8; without '%', so that an importer may take it for a format. */
void write_message(char message[MESSAGE_SIZE], const char *format, ...);
void write_message_of(char message[MESSAGE_SIZE], const char *format, va_list arguments);
INTERNAL_END

#endif
