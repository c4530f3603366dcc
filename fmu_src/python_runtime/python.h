/* Python from C, without its headers: the few functions of the stable ABI that are used, declared here and found at run time.
 * So nothing of Python is needed to compile this, and any Python from 3.11 on will do. */
#ifndef TENSEGRITY_PYTHON_H
#define TENSEGRITY_PYTHON_H

#include <stddef.h>

typedef struct PyObject PyObject;

/* Of the stable ABI since 3.11. */
typedef struct {
    void *buf;
    PyObject *obj;
    ptrdiff_t len, itemsize;
    int readonly, ndim;
    char *format;
    ptrdiff_t *shape, *strides, *suboffsets;
    void *internal;
} Py_buffer;

enum { PYTHON_FILE_INPUT = 257, PYTHON_BUFFER_FORMAT = 0x4 | 0x8 /* with format and shape */ };

/* X(result, name, arguments) */
#define PYTHON_FUNCTIONS(X)                                                            \
    X(int, Py_IsInitialized, (void))                                                   \
    X(const char *, Py_GetVersion, (void))                                             \
    X(void, Py_InitializeEx, (int))                                                    \
    X(wchar_t *, Py_DecodeLocale, (const char *, size_t *))                            \
    X(void *, PyEval_SaveThread, (void))                                               \
    X(int, PyGILState_Ensure, (void))                                                  \
    X(void, PyGILState_Release, (int))                                                 \
    X(void, Py_DecRef, (PyObject *))                                                   \
    X(PyObject *, Py_BuildValue, (const char *, ...))                                  \
    X(PyObject *, Py_CompileString, (const char *, const char *, int))                 \
    X(PyObject *, PyEval_EvalCode, (PyObject *, PyObject *, PyObject *))               \
    X(PyObject *, PyEval_GetBuiltins, (void))                                          \
    X(PyObject *, PyDict_New, (void))                                                  \
    X(int, PyDict_SetItemString, (PyObject *, const char *, PyObject *))               \
    X(PyObject *, PyDict_GetItemString, (PyObject *, const char *))                    \
    X(PyObject *, PyObject_GetAttrString, (PyObject *, const char *))                  \
    X(PyObject *, PyObject_Str, (PyObject *))                                          \
    X(PyObject *, PyObject_CallFunctionObjArgs, (PyObject *, ...))                     \
    X(PyObject *, PyObject_CallMethodObjArgs, (PyObject *, PyObject *, ...))           \
    X(int, PyObject_IsTrue, (PyObject *))                                              \
    X(int, PyObject_GetBuffer, (PyObject *, Py_buffer *, int))                         \
    X(void, PyBuffer_Release, (Py_buffer *))                                           \
    X(PyObject *, PyMemoryView_FromObject, (PyObject *))                               \
    X(PyObject *, PyBytes_FromStringAndSize, (const char *, ptrdiff_t))                \
    X(int, PyBytes_AsStringAndSize, (PyObject *, char **, ptrdiff_t *))                \
    X(PyObject *, PyUnicode_InternFromString, (const char *))                          \
    X(PyObject *, PyUnicode_DecodeFSDefault, (const char *))                           \
    X(PyObject *, PyUnicode_DecodeUTF8, (const char *, ptrdiff_t, const char *))       \
    X(PyObject *, PyUnicode_AsEncodedString, (PyObject *, const char *, const char *)) \
    X(PyObject *, PyFloat_FromDouble, (double))                                        \
    X(double, PyFloat_AsDouble, (PyObject *))                                          \
    X(PyObject *, PyLong_FromLong, (long))                                             \
    X(long, PyLong_AsLong, (PyObject *))                                               \
    X(PyObject *, PyBool_FromLong, (long))                                             \
    X(PyObject *, PyList_New, (ptrdiff_t))                                             \
    X(int, PyList_Append, (PyObject *, PyObject *))                                    \
    X(ptrdiff_t, PyList_Size, (PyObject *))                                            \
    X(PyObject *, PyList_GetItem, (PyObject *, ptrdiff_t))                             \
    X(PyObject *, PyErr_Occurred, (void))                                              \
    X(void, PyErr_Clear, (void))                                                       \
    X(void, PyErr_Fetch, (PyObject **, PyObject **, PyObject **))                      \
    X(void, PyErr_NormalizeException, (PyObject **, PyObject **, PyObject **))         \
    X(int, PyException_SetTraceback, (PyObject *, PyObject *))

typedef struct {
#define X(result, name, arguments) result(*name) arguments;
    PYTHON_FUNCTIONS(X)
#undef X
} python;

/* A text that grows; text: NULL until something was added. */
typedef struct {
    char *text;
    size_t length, capacity;
} report;

void report_add(report *to, const char *format, ...);
char *text_copy(const char *text); /* malloc'ed */

/* python.c: find Python's functions, and start an interpreter where none is running.  0 with what was looked for, and what
 * helps, in why. */
int python_attach(python *py, report *why);

PyObject *python_text(const python *py, const char *text); /* of a path or an environment variable */

/* Run a source in a namespace of its own that has one more name; the namespace, NULL with Python's exception set. */
PyObject *python_run(const python *py, const char *source, const char *file, const char *key, PyObject *value);

/* library.c: shared libraries of the process. */
typedef void (*library_function)(void);
void *library_of_python(void);                     /* the one in the process that is a Python; NULL: none */
void *library_open(const char *path, report *why); /* for all of the process; never closed */
library_function library_symbol(void *library, const char *name);
void *library_lock(library_function inside); /* only one thread of the process, whatever library it runs, goes on */
void library_unlock(void *lock);

/* search.c: an interpreter with NumPy and the shared library that belongs to it. */
typedef struct {
    char *program; /* path of the interpreter */
    char *path;    /* its sys.path, entries that end with 0, then an empty one */
    void *library;
} interpreter;

int search_interpreter(interpreter *found, int minor, report *why); /* minor: of Python 3, if it must be that; else 0 */
void free_interpreter(interpreter *found);

/* process.c: what a program prints when it is called with these arguments, at most `capacity` bytes; -1 where it cannot be run
 * or takes longer than 20 s. */
ptrdiff_t process_output(const char *program, const char *first, const char *second, char *output, size_t capacity);
char *process_environment(const char *name); /* value in UTF-8, or as it is, malloc'ed; NULL: not set or empty */
int process_exists(const char *path);        /* is there a file that could be run? */
char *process_target(const char *path);      /* the path without links, malloc'ed; NULL: unknown */
#if defined(_WIN32)
wchar_t *process_wide(const char *text); /* from UTF-8, malloc'ed */
#endif

#endif
