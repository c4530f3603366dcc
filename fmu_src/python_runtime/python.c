/* Python in the process: found where it is there, else started.  An interpreter that was started here is never ended: NumPy and
 * others cannot be unloaded, other FMUs may use it, and at the end of the process nothing is left to be done. */
#include "python.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define OLDEST 11 /* of Python 3: the buffers are in the stable ABI since then */

void report_add(report *to, const char *format, ...)
{
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    int n = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    size_t needed = n > 0 ? to->length + (size_t)n + 1 : 0;
    if (needed > to->capacity) {
        char *text = realloc(to->text, 2 * needed);
        if (text) to->text = text, to->capacity = 2 * needed;
    }
    if (needed && needed <= to->capacity) to->length += (size_t)vsnprintf(to->text + to->length, (size_t)n + 1, format, again);
    va_end(again);
}

char *text_copy(const char *text)
{
    char *copy = malloc(strlen(text) + 1);
    return copy ? strcpy(copy, text) : NULL;
}

static int resolve(python *py, void *library, report *why)
{
    library_function function;
#define X(result, name, arguments)                                     \
    if (!(function = library_symbol(library, #name))) {                \
        report_add(why, "the Python in this process lacks %s", #name); \
        return 0;                                                      \
    }                                                                  \
    memcpy(&py->name, &function, sizeof function);
    PYTHON_FUNCTIONS(X)
#undef X
    return 1;
}

static int version_of(const python *py, report *why)
{
    int major = 0, minor = 0;
    if (sscanf(py->Py_GetVersion(), "%d.%d", &major, &minor) == 2 && major == 3 && minor >= OLDEST) return minor;
    const char *remedy = "run the FMU in a process with a newer one, or in one without Python, which then looks for one";
    const char *form = "the Python in this process is %.16s, but 3.%d or newer is needed; %s";
    report_add(why, form, py->Py_GetVersion(), OLDEST, remedy);
    return 0;
}

/* After a start: the search path is that of the interpreter that was found, and what is printed appears at once, since nobody
 * ends this Python. */
static const char settle[] = "import os, sys\n"
                             "for entry in told:\n"
                             "    if entry not in sys.path:\n"
                             "        sys.path.append(entry)\n"
                             "for stream in (sys.stdout, sys.stderr):\n"
                             "    if hasattr(stream, 'reconfigure'):\n"
                             "        stream.reconfigure(line_buffering=True, errors='backslashreplace')\n";

PyObject *python_text(const python *py, const char *text)
{
#if defined(_WIN32)
    return py->PyUnicode_DecodeUTF8(text, (ptrdiff_t)strlen(text), "replace");
#else
    return py->PyUnicode_DecodeFSDefault(text);
#endif
}

PyObject *python_run(const python *py, const char *source, const char *name, const char *key, PyObject *value)
{
    PyObject *space = py->PyDict_New(), *code = py->Py_CompileString(source, name, PYTHON_FILE_INPUT), *done = NULL;
    if (space && code && value && !py->PyDict_SetItemString(space, "__builtins__", py->PyEval_GetBuiltins()) &&
        !py->PyDict_SetItemString(space, key, value))
        done = py->PyEval_EvalCode(code, space, space);
    py->Py_DecRef(code);
    if (!done) {
        py->Py_DecRef(space);
        return NULL;
    }
    py->Py_DecRef(done);
    return space;
}

static void use_path(const python *py, const char *path)
{
    PyObject *told = py->PyList_New(0);
    for (const char *entry = path; told && *entry; entry += strlen(entry) + 1) {
        PyObject *text = python_text(py, entry);
        if (text) py->PyList_Append(told, text);
        py->Py_DecRef(text);
    }
    py->Py_DecRef(python_run(py, settle, "<start of Python>", "told", told));
    py->Py_DecRef(told);
    py->PyErr_Clear();
}

static wchar_t *wide_path(const python *py, const char *path)
{
#if defined(_WIN32)
    (void)py;
    return process_wide(path);
#else
    return py->Py_DecodeLocale(path, NULL);
#endif
}

/* Start the interpreter as the program that was found starts itself, so that it has that one's packages. */
static void start(const python *py, const interpreter *found)
{
    void (*set_program)(const wchar_t *);
    library_function function = library_symbol(found->library, "Py_SetProgramName");
    wchar_t *program = function ? wide_path(py, found->program) : NULL; /* Python keeps it */
    memcpy(&set_program, &function, sizeof function);
    if (program) set_program(program);
    py->Py_InitializeEx(0);
    use_path(py, found->path);
    py->PyEval_SaveThread();
}

int python_attach(python *py, report *why)
{
    interpreter found = {NULL, NULL, NULL};
    void *library = library_of_python();
    int minor = 0;
    if (library && (!resolve(py, library, why) || !(minor = version_of(py, why)))) return 0;
    if (!library || !py->Py_IsInitialized()) {
        if (!search_interpreter(&found, minor, why)) {
            const char *remedy = "name one, 3.%d or newer and with NumPy, in the environment variable TENSEGRITY_PYTHON";
            report_add(why, remedy, OLDEST);
            return 0;
        }
        if (library) found.library = library;
    }
    int works = library || (resolve(py, found.library, why) && version_of(py, why));
    if (works) {
        void *lock = library_lock((library_function)py->Py_IsInitialized);
        if (!py->Py_IsInitialized()) start(py, &found);
        library_unlock(lock);
    }
    free_interpreter(&found);
    return works;
}
