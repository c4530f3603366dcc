/* The stepping loop, and the step that a call leaves open for those that follow. */
#ifndef TENSEGRITY_INTEGRATE_H
#define TENSEGRITY_INTEGRATE_H

#include "model/data.h"
#include "tensegrity.h"

int ts_integrate(ts_sim *sim, double h, int may_run_ahead);
int ts_span_serves(const ts_span *span, double h);
void ts_serve_span(ts_sim *sim, double h);
void ts_close_span(ts_sim *sim);
void ts_bring_motion(ts_sim *sim);
void ts_bring_state(ts_sim *sim);
void ts_clear_scratch(const ts_sim *sim, ts_memory *memory, char *ahead);
int ts_fixed_step(int method);

#endif
