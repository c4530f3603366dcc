/* The classical Runge-Kutta method of order 4.
 *
 * W. Kutta, Beitrag zur naeherungsweisen Integration totaler Differentialgleichungen, Zeitschrift fuer Mathematik und
 * Physik 46, 1901; as in E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993, section II.1,
 * doi:10.1007/978-3-540-78862-1.  A: stages 0..3 and the end (4); B = A[4].  tests/native/test_tableaus.py checks the order. */
static const double C[5] = {0, 0.5, 0.5, 1.0, 1.0};
static const double A[5][4] = {
    {0, 0, 0, 0}, {0.5, 0, 0, 0}, {0, 0.5, 0, 0}, {0, 0, 1.0, 0},
    {0.16666666666666666, 0.3333333333333333, 0.3333333333333333, 0.16666666666666666}};
