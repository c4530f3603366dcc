/* A winch: its rest length L follows a command c, at a limited rate.
 *
 *     L' = v clipped to -v_max ... v_max,  v = (c - L) / T
 *
 * With c = a + b t the wanted rate v obeys v' = (b - L') / T: linear in time while it is clipped, an exponential towards b while it
 * is not.  Either way it is monotone, so that a step has three phases at most, each in closed form. */
#include "block.h"

#include <math.h>

enum { LENGTH };

static double clipped(double rate, double limit) { return rate > limit ? limit : rate < -limit ? -limit : rate; }

static void show(block *b, double command, double slope, int at_limit)
{
    double time = b->value[TIME_CONSTANT];
    double wanted = (command - b->state[LENGTH]) / time;
    b->value[REST_LENGTH] = b->state[LENGTH];
    b->value[REST_LENGTH_RATE] = b->slope[REST_LENGTH] = clipped(wanted, b->value[RATE_LIMIT]);
    b->slope[REST_LENGTH_RATE] = at_limit ? 0.0 : (slope - wanted) / time;
}

void block_start(block *b)
{
    b->state[LENGTH] = b->value[START_REST_LENGTH];
    double wanted = (b->value[COMMAND] - b->state[LENGTH]) / b->value[TIME_CONSTANT];
    show(b, b->value[COMMAND], 0.0, fabs(wanted) > b->value[RATE_LIMIT]);
}

void block_step(block *b, double h)
{
    const double time = b->value[TIME_CONSTANT], limit = b->value[RATE_LIMIT], slope = b->slope[COMMAND];
    double wanted = (b->value[COMMAND] - b->state[LENGTH]) / time;
    double side = fabs(wanted) >= limit ? copysign(1.0, wanted) : copysign(1.0, slope);
    int at_limit = side * wanted > limit || (side * wanted == limit && side * slope > limit);
    for (double left = h; left > 0.0;) {
        double spent = left;
        if (at_limit) {
            double approach = (limit - side * slope) / time; /* of the limit by the wanted rate */
            double until = approach > 0.0 ? (side * wanted - limit) / approach : INFINITY;
            if (until < left) spent = fmax(until, 0.0);
            b->state[LENGTH] += side * limit * spent;
        } else {
            side = copysign(1.0, slope);
            double beyond = side * slope > limit ? (side * slope - limit) / (side * (slope - wanted)) : 0.0;
            double until = beyond > 0.0 ? -time * log(beyond) : INFINITY;
            if (until < left) spent = fmax(until, 0.0);
            b->state[LENGTH] += slope * spent - (wanted - slope) * time * expm1(-spent / time);
        }
        if (spent < left) at_limit = !at_limit;
        left -= spent;
        wanted = (b->value[COMMAND] + slope * (h - left) - b->state[LENGTH]) / time;
    }
    show(b, b->value[COMMAND] + slope * h, slope, at_limit);
}
