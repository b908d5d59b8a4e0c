#include "message.h"

#include <stdio.h>
#include <string.h>

/* Removes the bytes of an incomplete last character. */
static void drop_cut_character(char *message)
{
    size_t n = strlen(message), start = n;
    while (start > 0 && ((unsigned char)message[start - 1] & 0xC0) == 0x80)
        start--;
    if (start == 0)
        return;
    unsigned char lead = (unsigned char)message[start - 1];
    size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : lead >= 0xC0 ? 2 : 1;
    if (n - (start - 1) < length)
        message[start - 1] = 0;
}

void write_message_of(char message[MESSAGE_SIZE], const char *format, va_list arguments)
{
    vsnprintf(message, MESSAGE_SIZE, format, arguments);
    drop_cut_character(message);
    for (char *c = message; *c; c++)
        if (*c == '%' || *c == '#') /* FMI interprets #...# as a reference to a variable */
            *c = '_';
}

void write_message(char message[MESSAGE_SIZE], const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_message_of(message, format, arguments);
    va_end(arguments);
}
