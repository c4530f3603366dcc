/* Coefficients of the Runge-Kutta pair of Dormand and Prince of order 5(4) with dense output of order 4.
 *
 * J. R. Dormand, P. J. Prince, A family of embedded Runge-Kutta formulae, Journal of Computational and Applied Mathematics 6, 1980,
 * doi:10.1016/0771-050X(80)90013-3; dense output: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I,
 * 1993, doi:10.1007/978-3-540-78862-1, section II.6.
 * A: stages 0..5 and the end (6), whose derivative is the last stage; E: error estimate; DENSE: the last row of dense output.
 * tests/native/test_tableaus.py checks the order conditions. */
static const double C[7] = {0, 0.2, 0.3, 0.8, 0.8888888888888888, 1.0, 1.0};
static const double A[7][7] = {
    {0, 0, 0, 0, 0, 0, 0},
    {0.2, 0, 0, 0, 0, 0, 0},
    {0.075, 0.225, 0, 0, 0, 0, 0},
    {0.9777777777777777, -3.7333333333333334, 3.5555555555555554, 0, 0, 0, 0},
    {2.9525986892242035, -11.595793324188385, 9.822892851699436, -0.2908093278463649, 0, 0, 0},
    {2.8462752525252526, -10.757575757575758, 8.906422717743473, 0.2784090909090909, -0.2735313036020583, 0, 0},
    {0.09114583333333333, 0, 0.44923629829290207, 0.6510416666666666, -0.322376179245283, 0.13095238095238096, 0}};
static const double E[7] = {0.0012326388888888888, 0, -0.0042527702905061394, 0.03697916666666667, -0.05086379716981132, 0.0419047619047619, -0.025};
static const double DENSE[7] = {-1.1270175653862835, 0, 2.675424484351598, -5.685526961588504, 3.5219323679207912, -1.7672812570757455, 2.382468931778144};
