/* May a call be made now? */
#ifndef TENSEGRITY_READY_H
#define TENSEGRITY_READY_H

#include "tensegrity.h"

int ts_free_of_steps(ts_sim *sim);
int ts_started(ts_sim *sim);
int ts_ready(ts_sim *sim);

#endif
