/* FMI 2.0 for co-simulation over a Python object: each function calls the method of the slave (slave.py) that belongs to it.
 *
 * What is right or wrong, and which status it has, the slave says: a method returns None or a status, or raises.  Values go as
 * whole arrays, by Python's buffers.  Python is called with its lock held; the host's logger is called without it, when the
 * method has returned.  Nothing of Python points into this library, so that the host may unload it. */
#include "fmi2Functions.h"
#include "python.h"
#include "resources.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* clang-format off */ /* names in rows */
#define HOOKS(X)                                                                                                 \
    X(setup_experiment) X(enter_initialization_mode) X(exit_initialization_mode) X(terminate) X(reset)           \
    X(do_step) X(cancel_step) X(get_real) X(get_integer) X(get_boolean) X(get_string) X(set_real) X(set_integer) \
    X(set_boolean) X(set_string) X(set_real_input_derivatives) X(get_real_output_derivatives)                    \
    X(get_directional_derivative) X(get_status) X(get_real_status) X(get_integer_status) X(get_boolean_status)   \
    X(get_string_status) X(set_debug_logging) X(null_pointer) X(short_vector) X(_get_fmu_state)                  \
    X(_set_fmu_state) X(_fmu_state_to_bytes) X(_fmu_state_from_bytes) X(_get_log_queue) X(cast)

#define HELPERS(X) X(explain) X(drain) X(packed)
/* clang-format on */

enum {
#define X(name) HOOK_##name,
    HOOKS(X)
#undef X
        HOOK_COUNT
};

enum {
#define X(name) HELPER_##name,
    HELPERS(X)
#undef X
        HELPER_COUNT
};

typedef struct {
    fmi2CallbackFunctions host;
    char *name; /* of the instance */
    python py;
    PyObject *slave, *none;
    PyObject *hook[HOOK_COUNT];     /* names of methods */
    PyObject *helper[HELPER_COUNT]; /* functions of bridge.py */
    PyObject *code[3];              /* "I", "i" and "d", of arrays */
    PyObject *strings;              /* that the host was given last */
} instance;

enum { REFERENCES, INTEGERS, REALS };
static const size_t item_size[] = {sizeof(fmi2ValueReference), sizeof(fmi2Integer), sizeof(fmi2Real)};
static const char *const item_code[] = {"I", "i", "d"};
static const char *const item_formats[] = {"I", "il", "d"}; /* that are the same to C, where the size is */

/* A fmi2FMUstate: what the slave calls a state, as bytes. */
typedef struct {
    size_t size;
    char bytes[];
} saved;

/* ------------------------------------------------------------------------------------------------------------ messages */

typedef struct message {
    struct message *next;
    fmi2Status status;
    char *category, *text;
} message;

/* The host takes the message as a format of printf, and # as the mark of a variable: both are doubled. */
static void say(const instance *fmu, fmi2Status status, const char *category, const char *text)
{
    char *escaped = malloc(2 * strlen(text) + 1), *to = escaped;
    if (escaped && fmu->host.logger) {
        for (; *text; text++) {
            if (*text == '%' || *text == '#') *to++ = *text;
            *to++ = *text;
        }
        *to = 0;
        fmu->host.logger(fmu->host.componentEnvironment, fmu->name, status, category, escaped);
    }
    free(escaped);
}

static char *copy_of(const char *text, size_t size)
{
    char *copy = malloc(size + 1);
    if (!copy) return NULL;
    memcpy(copy, text, size);
    copy[size] = 0;
    return copy;
}

/* Bytes of Python as a text; NULL where they are none. */
static char *text_of(const python *py, PyObject *bytes)
{
    char *bare;
    ptrdiff_t size;
    return bytes && !py->PyBytes_AsStringAndSize(bytes, &bare, &size) ? copy_of(bare, (size_t)size) : NULL;
}

/* The slave's messages, taken out of Python; most calls have none. */
static message *messages(const instance *fmu)
{
    const python *py = &fmu->py;
    message *first = NULL, **last = &first;
    PyObject *queue = py->PyObject_CallMethodObjArgs(fmu->slave, fmu->hook[HOOK__get_log_queue], NULL), *list = NULL;
    if (queue && py->PyList_Size(queue) > 0) list = py->PyObject_CallFunctionObjArgs(fmu->helper[HELPER_drain], queue, NULL);
    for (ptrdiff_t i = 0; list && i + 2 < py->PyList_Size(list); i += 3) {
        message *m = calloc(1, sizeof *m);
        if (!m) break;
        m->status = (fmi2Status)py->PyLong_AsLong(py->PyList_GetItem(list, i));
        m->category = text_of(py, py->PyList_GetItem(list, i + 1));
        m->text = text_of(py, py->PyList_GetItem(list, i + 2));
        *last = m;
        last = &m->next;
    }
    py->Py_DecRef(list);
    py->Py_DecRef(queue);
    py->PyErr_Clear();
    return first;
}

static void send(const instance *fmu, message *m)
{
    while (m) {
        message *next = m->next;
        if (m->category && m->text) say(fmu, m->status, m->category, m->text);
        free(m->category);
        free(m->text);
        free(m);
        m = next;
    }
}

/* --------------------------------------------------------------------------------------------------------- Python calls */

static int enter(const instance *fmu, int *lock, const char *what)
{
    if (!fmu) return 0;
    if (fmu->py.Py_IsInitialized()) {
        *lock = fmu->py.PyGILState_Ensure();
        return 1;
    }
    report ended = {NULL, 0, 0};
    report_add(&ended, "%s: the host has ended Python", what);
    if (ended.text) say(fmu, fmi2Error, "logStatusError", ended.text);
    free(ended.text);
    return 0;
}

static fmi2Status leave(const instance *fmu, int lock, fmi2Status status)
{
    message *said = messages(fmu);
    fmu->py.PyGILState_Release(lock);
    send(fmu, said);
    return status;
}

#define ENTER_AS(component, what) \
    instance *fmu = component;    \
    int lock;                     \
    if (!enter(fmu, &lock, what)) return fmi2Error

#define ENTER(component) ENTER_AS(component, __func__)

/* The present exception, cleared; a new reference, NULL where there is none. */
static PyObject *exception(const python *py)
{
    PyObject *type = NULL, *value = NULL, *trace = NULL;
    py->PyErr_Fetch(&type, &value, &trace);
    py->PyErr_NormalizeException(&type, &value, &trace);
    if (value && trace) py->PyException_SetTraceback(value, trace);
    py->Py_DecRef(type);
    py->Py_DecRef(trace);
    return value;
}

/* The slave's words for the present exception, and its status. */
static fmi2Status explain(const instance *fmu)
{
    const python *py = &fmu->py;
    PyObject *error = exception(py);
    long status = -1;
    if (error) {
        PyObject *found = py->PyObject_CallFunctionObjArgs(fmu->helper[HELPER_explain], fmu->slave, error, NULL);
        if (found) status = py->PyLong_AsLong(found);
        py->Py_DecRef(found);
        py->Py_DecRef(error);
    }
    py->PyErr_Clear();
    return status == fmi2Warning || status == fmi2Discard ? (fmi2Status)status : fmi2Error;
}

/* Call a method; the arguments are given away, and those behind the first NULL are none. */
static PyObject *invoke(const instance *fmu, int hook, PyObject *a, PyObject *b, PyObject *c)
{
    const python *py = &fmu->py;
    PyObject *result = NULL;
    if (!py->PyErr_Occurred()) result = py->PyObject_CallMethodObjArgs(fmu->slave, fmu->hook[hook], a, b, c, NULL);
    py->Py_DecRef(a);
    py->Py_DecRef(b);
    py->Py_DecRef(c);
    return result;
}

/* What a method returned as a status: None, or one. */
static fmi2Status status_of(const instance *fmu, PyObject *result)
{
    const python *py = &fmu->py;
    if (!result) return explain(fmu);
    long status = result == fmu->none ? fmi2OK : py->PyLong_AsLong(result);
    py->Py_DecRef(result);
    if (py->PyErr_Occurred()) return explain(fmu);
    return status >= fmi2OK && status <= fmi2Discard ? (fmi2Status)status : fmi2Error;
}

static fmi2Status simply(fmi2Component c, int hook, const char *what)
{
    ENTER_AS(c, what);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, hook, NULL, NULL, NULL)));
}

/* ---- Arguments: new references ---- */

static PyObject *none(const instance *fmu) { return fmu->py.Py_BuildValue(""); }
static PyObject *real(const instance *fmu, double x) { return fmu->py.PyFloat_FromDouble(x); }
static PyObject *real_or_none(const instance *fmu, int given, double x) { return given ? real(fmu, x) : none(fmu); }

static PyObject *text(const python *py, const char *s)
{
    return s ? py->PyUnicode_DecodeUTF8(s, (ptrdiff_t)strlen(s), "replace") : py->Py_BuildValue("");
}

/* A copy of the host's array that is Python's own, as a memoryview of its type; None for a null pointer. */
static PyObject *array(const instance *fmu, int kind, const void *items, size_t n)
{
    const python *py = &fmu->py;
    if (n && !items) return none(fmu);
    PyObject *bytes = py->PyBytes_FromStringAndSize(n ? items : "", (ptrdiff_t)(n * item_size[kind]));
    PyObject *view = bytes ? py->PyMemoryView_FromObject(bytes) : NULL;
    PyObject *typed = view ? py->PyObject_CallMethodObjArgs(view, fmu->hook[HOOK_cast], fmu->code[kind], NULL) : NULL;
    py->Py_DecRef(view);
    py->Py_DecRef(bytes);
    return typed;
}

static PyObject *references(const instance *fmu, const fmi2ValueReference vr[], size_t n, const void *values)
{
    return n && !values ? none(fmu) : array(fmu, REFERENCES, vr, n);
}

static PyObject *list_of_texts(const instance *fmu, const fmi2String items[], size_t n)
{
    const python *py = &fmu->py;
    if (n && !items) return none(fmu);
    PyObject *list = py->PyList_New(0);
    for (size_t i = 0; list && i < n; i++) {
        PyObject *item = text(py, items[i]);
        if (item) py->PyList_Append(list, item);
        py->Py_DecRef(item);
    }
    return list;
}

/* ---- Results ---- */

static int copied(const instance *fmu, PyObject *result, int kind, void *values, size_t n)
{
    const python *py = &fmu->py;
    Py_buffer view;
    if (py->PyObject_GetBuffer(result, &view, PYTHON_BUFFER_FORMAT)) {
        py->PyErr_Clear();
        return 0;
    }
    int same = view.format && *view.format && strchr(item_formats[kind], *view.format) && !view.format[1];
    int fits = same && (size_t)view.itemsize == item_size[kind] && (size_t)view.len == n * item_size[kind];
    if (fits && n) memcpy(values, view.buf, n * item_size[kind]);
    py->PyBuffer_Release(&view);
    return fits;
}

/* Values that a method returned into the host's array: an array of the type, or any numbers. */
static fmi2Status into(const instance *fmu, PyObject *result, int kind, void *values, size_t n)
{
    const python *py = &fmu->py;
    if (!result) return explain(fmu);
    fmi2Status status = fmi2OK;
    if (!copied(fmu, result, kind, values, n)) {
        PyObject *count = py->PyLong_FromLong((long)n);
        PyObject *other = py->PyObject_CallFunctionObjArgs(fmu->helper[HELPER_packed], fmu->code[kind], result, count, NULL);
        if (!other || !copied(fmu, other, kind, values, n)) status = explain(fmu);
        py->Py_DecRef(other);
        py->Py_DecRef(count);
    }
    py->Py_DecRef(result);
    return status;
}

/* ----------------------------------------------------------------------------------------------------------- inquiries */

FMI2_Export const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
FMI2_Export const char *fmi2GetVersion(void) { return fmi2Version; }

FMI2_Export fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    ENTER(c);
    PyObject *names = list_of_texts(fmu, categories, n);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK_set_debug_logging, fmu->py.PyBool_FromLong(on), names, NULL)));
}

/* ---------------------------------------------------------------------------------------------------------- life cycle */

static void release(instance *fmu)
{
    const python *py = &fmu->py;
    py->Py_DecRef(fmu->strings);
    py->Py_DecRef(fmu->slave);
    for (int i = 0; i < HOOK_COUNT; i++) py->Py_DecRef(fmu->hook[i]);
    for (int i = 0; i < HELPER_COUNT; i++) py->Py_DecRef(fmu->helper[i]);
    for (int i = 0; i < 3; i++) py->Py_DecRef(fmu->code[i]);
    py->Py_DecRef(fmu->none);
    py->PyErr_Clear();
}

FMI2_Export void fmi2FreeInstance(fmi2Component c)
{
    instance *fmu = c;
    if (!fmu) return;
    if (fmu->py.Py_IsInitialized()) {
        int lock = fmu->py.PyGILState_Ensure();
        release(fmu);
        fmu->py.PyGILState_Release(lock);
    }
    free(fmu->name);
    free(fmu);
}

/* "KeyError: 'a'" of the present exception; what the slave refuses needs no name. */
static void add_exception(const python *py, report *why)
{
    PyObject *error = exception(py);
    PyObject *type = error ? py->PyObject_GetAttrString(error, "__class__") : NULL;
    PyObject *parts[2] = {type ? py->PyObject_GetAttrString(type, "__name__") : NULL, error ? py->PyObject_Str(error) : NULL};
    for (int i = 0; i < 2; i++) {
        PyObject *bytes = parts[i] ? py->PyUnicode_AsEncodedString(parts[i], "utf-8", "replace") : NULL;
        char *words = text_of(py, bytes);
        int unnamed = !i && words && !strcmp(words, "Refused");
        if (!unnamed) report_add(why, i && why->length ? ": %s" : "%s", words ? words : "an exception of Python");
        free(words);
        py->Py_DecRef(bytes);
        py->Py_DecRef(parts[i]);
    }
    py->Py_DecRef(type);
    py->Py_DecRef(error);
    py->PyErr_Clear();
}

static PyObject *space_of(const python *py, const char *source, const char *path)
{
    PyObject *file = python_text(py, path);
    PyObject *space = file ? python_run(py, source, path, "__file__", file) : NULL;
    py->Py_DecRef(file);
    return space;
}

/* Whether slavemodule.txt holds the name of a module and the checksum of its file (pack.py), and nothing else. */
static int vouches(const char *text, size_t size, const char *name, const char *source, size_t source_size)
{
    char right[200];
    unsigned long long sum = fmu_checksum(FMU_CHECKSUM, source, source_size);
    snprintf(right, sizeof right, "%s\n%016llx\n", name, sum);
    return size == strlen(right) && !memcmp(text, right, size);
}

/* The source of the main module, which looks after all other files; NULL with the reason.  file: its name. */
static char *main_source(const char *location, char file[160], char *reason, size_t capacity)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_";
    size_t size = 0, source_size = 0;
    char *list = fmu_resource(location, "slavemodule.txt", &size, reason, capacity), *source = NULL;
    size_t length = list ? strspn(list, letters) : 0;
    if (!list) return NULL;
    if (!length || length > 150 || list[length] != '\n') {
        snprintf(reason, capacity, "resources/slavemodule.txt is damaged; unzip the FMU anew");
    } else {
        snprintf(file, 160, "%.*s.py", (int)length, list);
        source = fmu_resource(location, file, &source_size, reason, capacity);
    }
    file[source ? length : 0] = 0; /* without the suffix, to compare */
    if (source && !vouches(list, size, file, source, source_size)) {
        snprintf(reason, capacity, "resources/%s.py or resources/slavemodule.txt is damaged; unzip the FMU anew", file);
        free(source);
        source = NULL;
    }
    if (source) strcat(file, ".py");
    free(list);
    return source;
}

/* The namespace that the FMU's main module leaves; NULL: with the reason in why, or as an exception. */
static PyObject *run_main(const python *py, const char *location, report *why)
{
    char reason[512] = "", file[160] = "";
    char *source = main_source(location, file, reason, sizeof reason), *path = NULL;
    PyObject *space = NULL;
    if (source && (path = fmu_resource_path(location, file))) space = space_of(py, source, path);
    if (!source) report_add(why, "%s", reason);
    free(source);
    free(path);
    return space;
}

/* Whether all that is called later is there. */
static int prepare(instance *fmu, PyObject *bridge)
{
    const python *py = &fmu->py;
    fmu->none = none(fmu);
    for (int i = 0; i < 3; i++) fmu->code[i] = py->PyUnicode_InternFromString(item_code[i]);
#define X(name) fmu->hook[HOOK_##name] = py->PyUnicode_InternFromString(#name);
    HOOKS(X)
#undef X
#define X(name) \
    if (!(fmu->helper[HELPER_##name] = py->PyObject_GetAttrString(bridge, #name))) return 0;
    HELPERS(X)
#undef X
    return !py->PyErr_Occurred();
}

static int load(instance *fmu, const char *location, const char *guid, int visible, int logging, report *why)
{
    const python *py = &fmu->py;
    PyObject *space = run_main(py, location, why);
    PyObject *bridge = space ? py->PyDict_GetItemString(space, "bridge") : NULL; /* borrowed */
    PyObject *make = bridge && prepare(fmu, bridge) ? py->PyObject_GetAttrString(bridge, "instantiate") : NULL;
    char *folder = make ? fmu_resource_path(location, "") : NULL;
    if (folder) {
        PyObject *words[3] = {python_text(py, folder), text(py, fmu->name), text(py, guid)};
        PyObject *flags[2] = {py->PyBool_FromLong(visible), py->PyBool_FromLong(logging)};
        if (words[0] && words[1] && words[2])
            fmu->slave = py->PyObject_CallFunctionObjArgs(make, words[0], words[1], words[2], flags[0], flags[1], NULL);
        for (int i = 0; i < 3; i++) py->Py_DecRef(words[i]);
        for (int i = 0; i < 2; i++) py->Py_DecRef(flags[i]);
    }
    if (!fmu->slave && py->PyErr_Occurred()) add_exception(py, why);
    else if (!fmu->slave && !why->length) report_add(why, "the FMU's Python files are damaged; unzip it anew");
    free(folder);
    py->Py_DecRef(make);
    py->Py_DecRef(space);
    return fmu->slave != NULL;
}

FMI2_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                                          const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    report why = {NULL, 0, 0};
    instance *fmu = calloc(1, sizeof *fmu);
    if (!fmu) return NULL;
    if (functions) fmu->host = *functions;
    const int named = name && name[strspn(name, " \t\r\n")];
    fmu->name = copy_of(named ? name : "(no name)", named ? strlen(name) : 9);
    if (!fmu->name) report_add(&why, "out of memory");
    else if (!named) report_add(&why, "the instance needs a name");
    else if (type != fmi2CoSimulation) report_add(&why, "this FMU is for co-simulation only");
    else if (!guid || !location) report_add(&why, "GUID and resource location are needed");
    else if (python_attach(&fmu->py, &why)) {
        int lock = fmu->py.PyGILState_Ensure();
        if (load(fmu, location, guid, visible, logging, &why)) {
            free(why.text);
            leave(fmu, lock, fmi2OK);
            return fmu;
        }
        release(fmu);
        fmu->py.PyGILState_Release(lock);
    }
    report said = {NULL, 0, 0};
    report_add(&said, "%s: %s", __func__, why.text ? why.text : "out of memory");
    if (fmu->name && said.text) say(fmu, fmi2Error, "logStatusError", said.text);
    free(said.text);
    free(why.text);
    free(fmu->name);
    free(fmu);
    return NULL;
}

FMI2_Export fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                                           fmi2Boolean stop_defined, fmi2Real stop)
{
    ENTER(c);
    PyObject *end = real_or_none(fmu, stop_defined, stop), *accuracy = real_or_none(fmu, tolerance_defined, tolerance);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK_setup_experiment, real(fmu, start), end, accuracy)));
}

FMI2_Export fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return simply(c, HOOK_enter_initialization_mode, __func__);
}

FMI2_Export fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return simply(c, HOOK_exit_initialization_mode, __func__);
}

FMI2_Export fmi2Status fmi2Terminate(fmi2Component c) { return simply(c, HOOK_terminate, __func__); }
FMI2_Export fmi2Status fmi2Reset(fmi2Component c) { return simply(c, HOOK_reset, __func__); }

/* -------------------------------------------------------------------------------------------------------------- values */

static fmi2Status get(fmi2Component c, int hook, int kind, const fmi2ValueReference vr[], size_t n, void *values,
                      const char *what)
{
    ENTER_AS(c, what);
    PyObject *found = invoke(fmu, hook, references(fmu, vr, n, values), NULL, NULL);
    return leave(fmu, lock, into(fmu, found, kind, values, n));
}

static fmi2Status set(fmi2Component c, int hook, int kind, const fmi2ValueReference vr[], size_t n, const void *values,
                      const char *what)
{
    ENTER_AS(c, what);
    PyObject *given = array(fmu, kind, values, n);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, hook, array(fmu, REFERENCES, vr, n), given, NULL)));
}

FMI2_Export fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    return get(c, HOOK_get_real, REALS, vr, n, value, __func__);
}

FMI2_Export fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    return get(c, HOOK_get_integer, INTEGERS, vr, n, value, __func__);
}

FMI2_Export fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    return get(c, HOOK_get_boolean, INTEGERS, vr, n, value, __func__);
}

/* The texts live until the next call of this function. */
FMI2_Export fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    ENTER(c);
    const python *py = &fmu->py;
    PyObject *found = invoke(fmu, HOOK_get_string, references(fmu, vr, n, value), NULL, NULL);
    if (!found) return leave(fmu, lock, explain(fmu));
    PyObject *count = py->PyLong_FromLong((long)n);
    PyObject *list = py->PyObject_CallFunctionObjArgs(fmu->helper[HELPER_packed], fmu->none, found, count, NULL);
    py->Py_DecRef(count);
    py->Py_DecRef(found);
    if (!list) return leave(fmu, lock, explain(fmu));
    py->Py_DecRef(fmu->strings);
    fmu->strings = list;
    for (size_t i = 0; i < n; i++) {
        char *bare;
        ptrdiff_t size;
        value[i] = py->PyBytes_AsStringAndSize(py->PyList_GetItem(list, (ptrdiff_t)i), &bare, &size) ? "" : bare;
    }
    return leave(fmu, lock, fmi2OK);
}

FMI2_Export fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    return set(c, HOOK_set_real, REALS, vr, n, value, __func__);
}

FMI2_Export fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    return set(c, HOOK_set_integer, INTEGERS, vr, n, value, __func__);
}

FMI2_Export fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    return set(c, HOOK_set_boolean, INTEGERS, vr, n, value, __func__);
}

FMI2_Export fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    ENTER(c);
    PyObject *given = list_of_texts(fmu, value, n);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK_set_string, array(fmu, REFERENCES, vr, n), given, NULL)));
}

/* --------------------------------------------------------------------------------------------------------------- steps */

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real h, fmi2Boolean no_set_state_prior)
{
    ENTER(c);
    (void)no_set_state_prior;
    PyObject *done = invoke(fmu, HOOK_do_step, real(fmu, point), real(fmu, h), NULL);
    int good = done ? fmu->py.PyObject_IsTrue(done) : -1;
    fmu->py.Py_DecRef(done);
    return leave(fmu, lock, good < 0 ? explain(fmu) : good ? fmi2OK : fmi2Discard);
}

FMI2_Export fmi2Status fmi2CancelStep(fmi2Component c) { return simply(c, HOOK_cancel_step, __func__); }

/* What the slave answers to a question after its step: a new reference; NULL where it refuses, with the status. */
static PyObject *answer(const instance *fmu, int hook, fmi2StatusKind kind, const void *value, const char *what,
                        fmi2Status *status)
{
    const python *py = &fmu->py;
    PyObject *found = invoke(fmu, hook, py->PyLong_FromLong((long)kind), NULL, NULL);
    if (!found) *status = explain(fmu);
    if (!found || value) return found;
    py->Py_DecRef(found);
    *status = status_of(fmu, invoke(fmu, HOOK_null_pointer, text(py, what), NULL, NULL));
    return NULL;
}

FMI2_Export fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    ENTER(c);
    fmi2Status status = fmi2OK;
    PyObject *found = answer(fmu, HOOK_get_status, kind, value, __func__, &status);
    if (found) *value = status_of(fmu, found);
    return leave(fmu, lock, status);
}

FMI2_Export fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    ENTER(c);
    fmi2Status status = fmi2OK;
    PyObject *found = answer(fmu, HOOK_get_real_status, kind, value, __func__, &status);
    if (found) *value = fmu->py.PyFloat_AsDouble(found);
    fmu->py.Py_DecRef(found);
    return leave(fmu, lock, fmu->py.PyErr_Occurred() ? explain(fmu) : status);
}

static fmi2Status whole_status(fmi2Component c, int hook, fmi2StatusKind kind, int *value, const char *what)
{
    ENTER_AS(c, what);
    fmi2Status status = fmi2OK;
    PyObject *found = answer(fmu, hook, kind, value, what, &status);
    if (found) *value = (int)fmu->py.PyLong_AsLong(found);
    fmu->py.Py_DecRef(found);
    return leave(fmu, lock, fmu->py.PyErr_Occurred() ? explain(fmu) : status);
}

FMI2_Export fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    return whole_status(c, HOOK_get_integer_status, kind, value, __func__);
}

FMI2_Export fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    return whole_status(c, HOOK_get_boolean_status, kind, value, __func__);
}

/* There is nothing to say: the slave refuses. */
FMI2_Export fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    ENTER(c);
    (void)value;
    PyObject *number = fmu->py.PyLong_FromLong((long)kind);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK_get_string_status, number, NULL, NULL)));
}

/* ---------------------------------------------------------------------------------------------------------- derivatives */

FMI2_Export fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                   const fmi2Integer order[], const fmi2Real value[])
{
    ENTER(c);
    PyObject *orders = array(fmu, INTEGERS, order, n), *given = array(fmu, REALS, value, n);
    PyObject *places = array(fmu, REFERENCES, vr, n);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK_set_real_input_derivatives, places, orders, given)));
}

FMI2_Export fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[])
{
    ENTER(c);
    PyObject *orders = array(fmu, INTEGERS, order, n);
    PyObject *found = invoke(fmu, HOOK_get_real_output_derivatives, references(fmu, vr, n, value), orders, NULL);
    return leave(fmu, lock, into(fmu, found, REALS, value, n));
}

FMI2_Export fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                    const fmi2ValueReference known[], size_t knowns, const fmi2Real change[],
                                                    fmi2Real response[])
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)response;
    return simply(c, HOOK_get_directional_derivative, __func__);
}

/* -------------------------------------------------------------------------------------------------------------- states */

static fmi2Status null_pointer(fmi2Component c, const char *what)
{
    ENTER_AS(c, what);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK_null_pointer, text(&fmu->py, what), NULL, NULL)));
}

/* Bytes that a method returned, as a state; the memory of an earlier one is used again. */
static fmi2Status keep(const instance *fmu, PyObject *result, saved **state)
{
    const python *py = &fmu->py;
    char *bytes;
    ptrdiff_t size;
    if (!result) return explain(fmu);
    fmi2Status status = fmi2OK;
    if (py->PyBytes_AsStringAndSize(result, &bytes, &size)) {
        status = explain(fmu);
    } else {
        saved *fresh = realloc(*state, sizeof **state + (size_t)size);
        if (fresh) {
            fresh->size = (size_t)size;
            memcpy(fresh->bytes, bytes, (size_t)size);
            *state = fresh;
        } else {
            status = fmi2Error;
        }
    }
    py->Py_DecRef(result);
    return status;
}

static PyObject *bytes_of(const instance *fmu, const char *bytes, size_t size)
{
    return fmu->py.PyBytes_FromStringAndSize(bytes, (ptrdiff_t)size);
}

FMI2_Export fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (!state) return null_pointer(c, __func__);
    ENTER(c);
    saved *kept = *state;
    fmi2Status status = keep(fmu, invoke(fmu, HOOK__get_fmu_state, NULL, NULL, NULL), &kept);
    *state = kept;
    return leave(fmu, lock, status);
}

FMI2_Export fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    const saved *given = state;
    if (!given) return null_pointer(c, __func__);
    ENTER(c);
    PyObject *bytes = bytes_of(fmu, given->bytes, given->size);
    return leave(fmu, lock, status_of(fmu, invoke(fmu, HOOK__set_fmu_state, bytes, NULL, NULL)));
}

FMI2_Export fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (!c) return fmi2Error;
    if (!state) return fmi2OK;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* The state as the bytes that the slave makes of it; malloc'ed, NULL with the status. */
static saved *serialised(const instance *fmu, const saved *state, const char *what, fmi2Status *status)
{
    saved *bytes = NULL;
    PyObject *given = bytes_of(fmu, state->bytes, state->size);
    *status = keep(fmu, invoke(fmu, HOOK__fmu_state_to_bytes, given, text(&fmu->py, what), NULL), &bytes);
    return bytes;
}

FMI2_Export fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    if (!state || !size) return null_pointer(c, __func__);
    ENTER(c);
    fmi2Status status;
    saved *bytes = serialised(fmu, state, __func__, &status);
    if (bytes) *size = bytes->size;
    free(bytes);
    return leave(fmu, lock, status);
}

FMI2_Export fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (!state || !bytes) return null_pointer(c, __func__);
    ENTER(c);
    fmi2Status status;
    saved *found = serialised(fmu, state, __func__, &status);
    if (found && found->size <= size) memcpy(bytes, found->bytes, found->size);
    else if (found) status = status_of(fmu, invoke(fmu, HOOK_short_vector, NULL, NULL, NULL));
    free(found);
    return leave(fmu, lock, status);
}

FMI2_Export fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    if (!bytes || !state) return null_pointer(c, __func__);
    ENTER(c);
    saved *kept = NULL;
    fmi2Status status = keep(fmu, invoke(fmu, HOOK__fmu_state_from_bytes, bytes_of(fmu, bytes, size), NULL, NULL), &kept);
    if (kept) *state = kept;
    return leave(fmu, lock, status);
}
