/* What must hold, whatever the model and the inputs: TS_ASSERT(condition).  The kernel that is shipped does not look; with
 * TS_ASSERTIONS, as in the tests, it says what does not hold and ends the process. */
#ifndef TENSEGRITY_INVARIANTS_H
#define TENSEGRITY_INVARIANTS_H

#if defined(TS_ASSERTIONS)
#include <stdio.h>
#include <stdlib.h>
#define TS_ASSERT(condition) \
    ((condition) ? (void)0 : (fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition), abort()))
#else
#define TS_ASSERT(condition) ((void)sizeof((condition) ? 1 : 0))
#endif

#endif
