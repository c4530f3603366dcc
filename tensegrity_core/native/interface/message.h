/* Why a call failed, in words. */
#ifndef TENSEGRITY_MESSAGE_H
#define TENSEGRITY_MESSAGE_H

#include "tensegrity.h"

void ts_say(ts_sim *sim, const char *text);

#endif
