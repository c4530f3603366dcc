/* Messages to the host's logger. */
#include "instance.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *const fmu_categories[LOG_CATEGORIES] = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logEvents",
                                                    "logSolver"};

/* A number that reads back as itself, with a point whatever the host's locale. */
const char *fmu_number(double x, char text[32])
{
    for (int digits = 15; digits <= 17; digits++) {
        double back = 0.0;
        snprintf(text, 32, "%.*g", digits, x);
        if (sscanf(text, "%lf", &back) == 1 && back == x) break;
    }
    for (char *c = text; *c; c++)
        if (!strchr("0123456789+-einfa", *c)) *c = '.';
    return text;
}

/* The host takes the message as a format of printf, and # as the mark of a variable: both are doubled.  What goes wrong is
 * always said; events and the solver's work only where the host asked for them. */
void fmu_log(const instance *fmu, int category, fmi2Status status, const char *format, ...)
{
    char text[1024], escaped[2 * sizeof text];
    size_t n = 0;
    va_list arguments;
    if (!fmu->host.logger || !fmu->log[category]) return;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    for (const char *c = text; *c; c++) {
        if (*c == '%' || *c == '#') escaped[n++] = *c;
        escaped[n++] = *c;
    }
    escaped[n] = 0;
    fmu->host.logger(fmu->host.componentEnvironment, fmu->name, status, fmu_categories[category], escaped);
}
