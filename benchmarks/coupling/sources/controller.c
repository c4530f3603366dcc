/* Three PI controllers of heights z by commands c to winches that pull up, each with a filter of its measurement.
 *
 *     y' = (z - y) / T,  x' = target - y,  c = neutral - k_p (target - y) - k_i x
 *
 * The commands depend on states only: nothing passes straight from input to output.  With z = a + b t all is in closed form. */
#include "block.h"

#include <math.h>

#define CHANNELS 3

static double *filtered(block *b, int i) { return &b->state[i]; }
static double *integral(block *b, int i) { return &b->state[CHANNELS + i]; }

/* height: at the present time, m. */
static void show(block *b, int i, double height)
{
    double y = *filtered(b, i), rate = (height - y) / b->value[FILTER_TIME], deviation = b->value[TARGET_1 + i] - y;
    b->value[COMMAND_1 + i] = b->value[NEUTRAL_1 + i] - b->value[GAIN] * deviation - b->value[INTEGRAL_GAIN] * *integral(b, i);
    b->slope[COMMAND_1 + i] = b->value[GAIN] * rate - b->value[INTEGRAL_GAIN] * deviation;
}

void block_start(block *b)
{
    for (int i = 0; i < CHANNELS; i++) {
        *filtered(b, i) = b->value[HEIGHT_1 + i];
        *integral(b, i) = 0.0;
        show(b, i, b->value[HEIGHT_1 + i]);
    }
}

void block_step(block *b, double h)
{
    const double time = b->value[FILTER_TIME];
    for (int i = 0; i < CHANNELS; i++) {
        double height = b->value[HEIGHT_1 + i], slope = b->slope[HEIGHT_1 + i];
        double lag = *filtered(b, i) - height + slope * time; /* y = z - slope T + lag exp(-t/T) */
        double kept = expm1(-h / time);
        double area = (height - slope * time) * h + 0.5 * slope * h * h - lag * time * kept; /* of y over the step */
        *filtered(b, i) = height + slope * (h - time) + lag * (1.0 + kept);
        *integral(b, i) += b->value[TARGET_1 + i] * h - area;
        show(b, i, height + slope * h);
    }
}
