/* Dense LU with partial pivoting, row-major. */
#include "internal.h"

#include <math.h>

/* Factorise A in place; pivot[j] is the row swapped into row j.  0 where A is singular or not finite. */
int ts_lu(int n, double *A, int32_t *pivot)
{
    for (int j = 0; j < n; j++) {
        int p = j;
        double largest = fabs(A[j * n + j]);
        for (int i = j + 1; i < n; i++)
            if (fabs(A[i * n + j]) > largest) {
                largest = fabs(A[i * n + j]);
                p = i;
            }
        if (!(largest > 0.0 && largest < INFINITY)) return 0;
        pivot[j] = p;
        if (p != j)
            for (int c = 0; c < n; c++) {
                double swap = A[j * n + c];
                A[j * n + c] = A[p * n + c];
                A[p * n + c] = swap;
            }
        double inverse = 1.0 / A[j * n + j];
        for (int i = j + 1; i < n; i++) {
            double factor = A[i * n + j] * inverse;
            A[i * n + j] = factor;
            if (factor != 0.0)
                for (int c = j + 1; c < n; c++) A[i * n + c] -= factor * A[j * n + c];
        }
    }
    return 1;
}

void ts_lu_solve(int n, const double *LU, const int32_t *pivot, double *b)
{
    for (int j = 0; j < n; j++) {
        double swap = b[pivot[j]];
        b[pivot[j]] = b[j];
        b[j] = swap;
    }
    for (int i = 1; i < n; i++) {
        double sum = b[i];
        for (int j = 0; j < i; j++) sum -= LU[i * n + j] * b[j];
        b[i] = sum;
    }
    for (int i = n - 1; i >= 0; i--) {
        double sum = b[i];
        for (int j = i + 1; j < n; j++) sum -= LU[i * n + j] * b[j];
        b[i] = sum / LU[i * n + i];
    }
}
