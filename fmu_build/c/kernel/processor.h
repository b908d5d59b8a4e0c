/* What the processor and the system can do. */
#ifndef PROCESSOR_H
#define PROCESSOR_H

#if defined(_WIN32)
#define OFFERED __declspec(dllexport)
#else
#define OFFERED __attribute__((visibility("default")))
#endif

/* The level of x86-64 [x86-64 psABI, 3.1.1] that processor and system support, 1 to 4; 0 on other processors. */
OFFERED int processor_level(void);

#endif
