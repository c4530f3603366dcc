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
    return status;
}

const char *ts_message(const ts_sim *sim) { return sim->told.message; }
const char *ts_status_name(int status) { return status >= 0 && status < TS_STATUS_COUNT ? status_names[status] : "?"; }
