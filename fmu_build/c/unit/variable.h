/* A row of the variable table in model.c, and the names and ranges of its slots. */
#ifndef VARIABLE_H
#define VARIABLE_H

#include "internal.h"

typedef enum { INPUT, STATE, RESULT, FIXED_PARAMETER, TUNABLE_PARAMETER, DERIVATIVE, INDEPENDENT } variable_role;
typedef enum { ANY, NOT_NEGATIVE, POSITIVE } variable_range;

/* A variable occupies `size` consecutive slots from `first`, row by row; every slot is one number. */
typedef struct {
    const char *name;
    const char *unit;
    int first;
    int size;
    int columns; /* of a matrix; 0 for a scalar or a vector */
    variable_role role;
    variable_range range;
} variable;

#define NAME_SIZE 80

INTERNAL_BEGIN
/* The variable to which a slot belongs. */
const variable *variable_of(int slot);
/* `name[row,column]` of a slot, 1-based. */
void write_slot_name(int slot, char name[NAME_SIZE]);
/* A description of the values that a slot can have, if this is not one of them, else NULL. */
const char *expected_of_slot(int slot, double value);
INTERNAL_END

#endif
