/* What the stepping loop knows of a method: a table of functions and properties. */
#ifndef TENSEGRITY_METHOD_H
#define TENSEGRITY_METHOD_H

#include "fields.h"
#include "model/data.h"
#include "tensegrity.h"

enum {
    TS_IMPLICIT = 1,         /* linearly implicit: uses the Jacobian */
    TS_FIXED_STEP = 2,       /* takes the step it is given */
    TS_ALWAYS_DENSE = 8,     /* its dense output is used anyway, to start the next step */
    TS_CLIPPED = 16,         /* dense output is weaker than the step: no step passes a communication point */
    TS_ENDS_IN_STAGES = 32,  /* its last stage is the derivative at the end of the step, put on the constraint */
    TS_LEDGER_IN_STAGES = 4, /* the ledger's integrals are among the stages; else the driver integrates the dense output */
};

/* A method advances y from tau by h under fixed pieces.  Adding one: a file with a table like this, and
 * a line in fields.py. */
typedef struct {
    double exponent;  /* of the error in the step size control */
    double growth;    /* largest growth of the step */
    double smoothing; /* exponent of the last step's error there (Gustafsson): fewer rejections */
    int flags;
    int splits; /* transitions located in one step at most; 0: all */
    int rows;   /* of ts_step_ahead's dense output that it uses */
    /* try a step from (tau, y, f0); leave the end in y1; return the error in units of the tolerance (NaN: failed) */
    double (*attempt)(ts_sim *sim, double tau, double h);
    /* dense output in rows 1.., row 0 being the step's start; only called when it is asked for */
    void (*densify)(ts_sim *sim, double tau, double h);
    /* components first..first+count-1 of y at tau + theta h, from the dense output alone */
    void (*interpolate)(const ts_step_ahead *ahead, double theta, int first, int count, double *out);
    /* y1 has been put on the constraint, the derivative there is in f1; NULL: nothing is left to do */
    void (*accepted)(ts_sim *sim, double h);
} ts_method;

#define TS_METHOD(NAME, name) extern const ts_method ts_##name;
TS_METHODS(TS_METHOD)
#undef TS_METHOD

#endif
