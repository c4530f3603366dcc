/* Why a call failed, in words. */
#ifndef TENSEGRITY_MESSAGE_H
#define TENSEGRITY_MESSAGE_H

#include "tensegrity.h"

int ts_say(ts_sim *sim, int status, const char *text);
int ts_refuse(ts_sim *sim, int32_t index, const char *text);

#endif
