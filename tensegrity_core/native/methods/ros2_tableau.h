/* ROS2: a Rosenbrock method of two stages, of order 2 with any matrix in the place of the Jacobian, L-stable.
 *
 * J. G. Verwer, E. J. Spee, J. G. Blom, W. Hundsdorfer, A second-order Rosenbrock method applied to photochemical dispersion
 * problems, SIAM Journal on Scientific Computing 20, 1999, doi:10.1137/S1064827597326651.
 * In the transformed variables U of Hairer and Wanner (Solving Ordinary Differential Equations II, section IV.7):
 * (I/(GAMMA h) - J) U_i = f(y + sum A_ij U_j) + sum C_ij U_j/h; y1 = y + sum M_i U_i.  GAMMA = 1 -+ 1/sqrt(2): both make
 * the method L-stable.  The first is the accurate one; the second, whose errors are 34 times as large, carries stage 2 less
 * far than the step instead of 3.4 times as far.  tests/native/test_tableaus.py checks the order conditions of both. */
static const double GAMMA[2] = {0.2928932188134524, 1.7071067811865475};
static const double A[2][2] = {{3.414213562373095, 0}, {0.585786437626905, 0}}; /* of stage 2 */
static const double C[2][2] = {{-6.82842712474619, 0}, {-1.17157287525381, 0}}; /* of stage 2 */
static const double ALPHA = 1.0;
static const double M[2][2] = {{5.121320343559642, 1.7071067811865475}, {0.8786796564403574, 0.2928932188134524}};
