/* Why a call failed, in words. */
#include "interface/message.h"
#include "model/data.h"
#include "tensegrity.h"

#include <stdio.h>

static const char *const status_names[] = {
#define TS_ERROR(name, text) #name,
#include "errors.def"
#undef TS_ERROR
};

/* Take down why a call ends with this status, which is returned. */
int ts_say(ts_sim *sim, int status, const char *text)
{
    snprintf(sim->told.message, sizeof sim->told.message, "%s", text);
    sim->told.concerned = -1;
    return status;
}

/* The same of a value that is refused; the text goes on from its name. */
int ts_refuse(ts_sim *sim, int32_t index, const char *text)
{
    ts_say(sim, TS_BAD_INPUT, text);
    sim->told.concerned = index;
    return TS_BAD_INPUT;
}

const char *ts_message(const ts_sim *sim) { return sim->told.message; }
int32_t ts_concerned(const ts_sim *sim) { return sim->told.concerned; }
const char *ts_status_name(int status) { return status >= 0 && status < TS_STATUS_COUNT ? status_names[status] : "?"; }
