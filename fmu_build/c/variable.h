/* One row of the variable table that model.c holds. */
#ifndef VARIABLE_H
#define VARIABLE_H

typedef enum { INPUT, STATE, RESULT, FIXED_PARAMETER, TUNABLE_PARAMETER, DERIVATIVE, INDEPENDENT } variable_role;
typedef enum { ANY, NOT_NEGATIVE, POSITIVE } variable_range;

/* A variable takes `size` consecutive slots from `first`, row by row; every slot is a number. */
typedef struct {
    const char *name;
    const char *unit;
    int first;
    int size;
    int columns; /* of a matrix; 0 for a scalar or a vector */
    variable_role role;
    variable_range range;
} variable;

#endif
