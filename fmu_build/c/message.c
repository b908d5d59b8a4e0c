#include "message.h"

#include <stdarg.h>
#include <stdio.h>

void write_message(char message[MESSAGE_SIZE], const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, MESSAGE_SIZE, format, arguments);
    va_end(arguments);
    for (char *c = message; *c; c++)
        if (*c == '%' || *c == '#') /* FMI reads #...# as a reference to a variable */
            *c = '_';
}
