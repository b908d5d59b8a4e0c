/* Symbols between these macros are not exported from the shared library, whatever the compiler's default is. */
#ifndef INTERNAL_H
#define INTERNAL_H

#if defined(__GNUC__) && !defined(_WIN32)
#define INTERNAL_BEGIN _Pragma("GCC visibility push(hidden)")
#define INTERNAL_END _Pragma("GCC visibility pop")
#else
#define INTERNAL_BEGIN
#define INTERNAL_END
#endif

#endif
