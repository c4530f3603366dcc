/* Beams in series without memory: how their force and energy change with their parameters. */
#ifndef TENSEGRITY_BEAMS_H
#define TENSEGRITY_BEAMS_H

typedef struct {
    const double *Q, *zeta, *h; /* (n) N, 1, m */
    int n;
    int snapped;      /* beams past their force maximum, those of the lowest maxima */
    double tension;   /* N */
    double stiffness; /* N/m, once all have bottomed out */
    double beyond;    /* m, that the string is longer then; -1: they have not */
    /* what follows: ts_beams_prepare() */
    int snapping;      /* the beam on its way from its maximum to that force again, or -1 */
    double force;      /* N, at which the others stand: the tension, or that maximum */
    double displaced;  /* m, of the snapping beam: what the others leave of the elongation */
    double slope;      /* N/m, of the snapping beam */
    double compliance; /* m/N, of the others together */
} ts_beams;

void ts_beams_prepare(ts_beams *b, double elongation);
void ts_beams_differentiate(const ts_beams *b, int beam, double force[3], double energy[3]);

#endif
