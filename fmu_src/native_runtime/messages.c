/* Messages to the host's logger. */
#include "calls.h"

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

/* FMI 2.0: what goes wrong is said unasked.  FMI 3.0 allows that of errors only. */
int fmu_always_said(const instance *fmu, int category)
{
    return fmu->standard->number == 2 ? category < LOG_EVENTS : category == LOG_ERROR;
}

/* Without categories all are meant.  FMI 2.0: those that are not named are off then. */
fmu_status fmu_set_logging(instance *fmu, const char *what, int on, size_t n, const char *const categories[])
{
    fmu_status status = FMU_OK;
    if (n && !categories) return fmu_refuse(fmu, what, "a null pointer was passed");
    for (int k = 0; k < LOG_CATEGORIES && (n == 0 || fmu->standard->number == 2); k++)
        fmu->log[k] = fmu_always_said(fmu, k) || (on && n == 0);
    for (size_t i = 0; i < n; i++) {
        int known = 0;
        for (int k = 0; k < LOG_CATEGORIES && categories[i]; k++)
            if (!strcmp(categories[i], fmu_categories[k])) {
                fmu->log[k] = fmu_always_said(fmu, k) || on;
                known = 1;
            }
        if (known) continue;
        status = FMU_WARNING;
        const char *name = categories[i] ? categories[i] : "(null)";
        fmu_log(fmu, LOG_WARNING, status, "%s: there is no log category %s", what, name);
    }
    return status;
}

void fmu_log(const instance *fmu, int category, fmu_status status, const char *format, ...)
{
    char text[FMU_LONGEST_MESSAGE];
    va_list arguments;
    if (!fmu->logger || !fmu->log[category]) return;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    fmu->standard->pass_on(fmu, status, fmu_categories[category], text);
}

/* A copy with these characters doubled, which mean something to the host.  The room for it is twice the text. */
void fmu_escape(const char *text, const char *characters, char *escaped)
{
    for (; *text; text++) {
        if (strchr(characters, *text)) *escaped++ = *text;
        *escaped++ = *text;
    }
    *escaped = 0;
}
