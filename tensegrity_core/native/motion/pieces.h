/* The piece of its force curve that a string is on, and what it bears there. */
#ifndef TENSEGRITY_PIECES_H
#define TENSEGRITY_PIECES_H

#include "tensegrity.h"

void ts_bear(ts_sim *sim, int string);
void ts_place(ts_sim *sim, int string, int piece);

#endif
