/* The search for an interpreter, where no Python is in the process yet.  docs/fmu.md has its order for users.
 *
 * Each candidate is asked, in a process of its own, what it is: one that does not start there would end the host here. */
#include "python.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define OLDEST 11    /* of Python 3 */
#define ANSWER 65536 /* bytes */
#define MOST 24      /* candidates that are asked */

#if defined(_WIN32)
#define SEPARATOR ';'
#define SLASH "\\"
#define HOME_PROGRAM "\\python.exe"
static const char *const names[] = {"python3.exe", "python.exe", "py.exe"};
static const char *const usual[] = {NULL};
#else
#define SEPARATOR ':'
#define SLASH "/"
#define HOME_PROGRAM "/bin/python3"
static const char *const names[] = {"python3", "python", "python3.14", "python3.13", "python3.12", "python3.11"};
static const char *const usual[] = {"/usr/local/bin", "/opt/homebrew/bin", "/usr/bin", NULL};
#endif

/* Records of a key, a space and a value, each ended by 0.  Also an old Python must be able to say its version. */
static const char question[] =
    "import os,sys\n"
    "if sys.path and sys.path[0]=='':del sys.path[0]\n"
    "def say(key,value):\n"
    "    value=value if isinstance(value,bytes) else value.encode('utf-8','surrogateescape')\n"
    "    getattr(sys.stdout,'buffer',sys.stdout).write(key.encode()+b' '+value+b'\\0')\n"
    "say('version','%d.%d'%sys.version_info[:2])\n"
    "say('program',sys.executable)\n"
    "say('prefix',os.path.realpath(sys.prefix))\n"
    "if sys.version_info>=(3,11):\n"
    "    import importlib.util,sysconfig\n"
    "    get=sysconfig.get_config_var\n"
    "    say('numpy','yes' if importlib.util.find_spec('numpy') else 'no')\n"
    "    folders=[get('LIBDIR'),os.path.join(sys.base_prefix,'lib'),get('PYTHONFRAMEWORKPREFIX'),sys.base_prefix]\n"
    "    files=[get('INSTSONAME'),get('LDLIBRARY'),'python%d%d.dll'%sys.version_info[:2]]\n"
    "    files=[name for name in files if name and not name.endswith('.a')]\n"
    "    places=[os.path.join(folder,name) for folder in folders if folder for name in files]\n"
    "    for place in dict.fromkeys(places):\n"
    "        if os.path.isfile(place):say('library',place)\n"
    "    ending='.dylib' if sys.platform=='darwin' else '.so.1.0'\n"
    "    if os.name!='nt':say('library','libpython%d.%d'%sys.version_info[:2]+ending)\n"
    "    for entry in sys.path:say('path',entry)\n";

/* The next record with the key behind a place in the answer, or its first; NULL: none */
static const char *record(const char *answer, const char *end, const char *key)
{
    size_t n = strlen(key);
    for (const char *at = answer; at < end; at += strlen(at) + 1)
        if (!strncmp(at, key, n) && at[n] == ' ') return at + n + 1;
    return NULL;
}

static const char *behind(const char *value) { return value + strlen(value) + 1; }

/* sys.path as entries that end with 0, then an empty one; malloc'ed. */
static char *path_of(const char *answer, const char *end)
{
    char *path = malloc((size_t)(end - answer) + 1), *at = path;
    for (const char *entry = path ? record(answer, end, "path") : NULL; entry; entry = record(behind(entry), end, "path"))
        if (*entry) at = strcpy(at, entry) + strlen(entry) + 1;
    if (path) *at = 0;
    return path;
}

static void *library_of(const char *answer, const char *end, const char *program, report *why)
{
    report failed = {NULL, 0, 0};
    void *library = NULL;
    for (const char *at = record(answer, end, "library"); at && !library; at = record(behind(at), end, "library")) {
        if (failed.text) report_add(&failed, ", ");
        library = library_open(at, &failed);
    }
    const char *remedy = "install it (Debian, Ubuntu: the package libpython3.x; pyenv: PYTHON_CONFIGURE_OPTS=--enable-shared)";
    const char *reason = failed.text ? failed.text : "none";
    if (!library) report_add(why, "%s has no shared library that can be loaded (%s): %s; ", program, reason, remedy);
    free(failed.text);
    return library;
}

/* Is it one that has not been seen before, by another name?  seen: lines, each with what identifies a candidate */
static int is_new(const char *program, const char *version, const char *prefix, report *seen)
{
    report line = {NULL, 0, 0};
    char *itself = version ? NULL : process_target(program);
    report_add(&line, "\n%s %s\n", version ? version : "", version && prefix ? prefix : itself ? itself : program);
    int found = line.text && (!seen->text || !strstr(seen->text, line.text));
    if (found) report_add(seen, "%s", line.text);
    free(itself);
    free(line.text);
    return found;
}

/* Is it one that will do?  seen: the candidates so far, of which each is reported once. */
static int ask(const char *program, int minor, interpreter *found, report *seen, report *why)
{
    char *answer = malloc(ANSWER + 1);
    ptrdiff_t size = answer ? process_output(program, "-c", question, answer, ANSWER) : -1;
    const char *end = answer && size > 0 ? answer + size : answer, *version = NULL, *named = NULL, *numpy = NULL;
    if (size > 0) {
        answer[size] = 0;
        version = record(answer, end, "version");
        named = record(answer, end, "program");
        numpy = record(answer, end, "numpy");
    }
    int major = 0, its_minor = 0;
    if (!is_new(program, version, answer ? record(answer, end, "prefix") : NULL, seen)) {
        free(answer);
        return 0;
    }
    if (!version || sscanf(version, "%d.%d", &major, &its_minor) != 2) {
        report_add(why, "%s does not answer as Python does; ", program);
    } else if (major != 3 || its_minor < OLDEST) {
        report_add(why, "%s is Python %s, but 3.%d or newer is needed; ", program, version, OLDEST);
    } else if (minor && its_minor != minor) {
        report_add(why, "%s is Python %s, but 3.%d is in the process; ", program, version, minor);
    } else if (!numpy || strcmp(numpy, "yes")) {
        report_add(why, "%s (Python %s) has no NumPy: %s -m pip install numpy; ", program, version, program);
    } else {
        found->library = library_of(answer, end, program, why);
        found->program = text_copy(named && *named ? named : program);
        found->path = path_of(answer, end);
    }
    free(answer);
    if (found->library && found->program && found->path) return 1;
    free_interpreter(found);
    return 0;
}

void free_interpreter(interpreter *found)
{
    free(found->program);
    free(found->path);
    memset(found, 0, sizeof *found);
}

typedef struct {
    interpreter *found;
    int minor, asked;
    report tried; /* paths, each between line ends */
    report seen;
    report *why;
} hunt;

/* Try folder/name, once. */
static int try_program(hunt *h, const char *folder, size_t length, const char *name)
{
    char line[4096];
    int n = snprintf(line, sizeof line, "\n%.*s%s%s\n", (int)length, folder, *name == *SLASH ? "" : SLASH, name);
    if (!length || n < 1 || n >= (int)sizeof line || (h->tried.text && strstr(h->tried.text, line))) return 0;
    report_add(&h->tried, "%s", line);
    line[n - 1] = 0;
#if defined(__APPLE__) /* a stub that asks the user to install tools, or too old */
    if (!strncmp(line + 1, "/usr/bin/", 9)) return 0;
#endif
    if (!process_exists(line + 1) || h->asked >= MOST) return 0;
    h->asked++;
    return ask(line + 1, h->minor, h->found, &h->seen, h->why);
}

static int try_path(hunt *h, const char *path)
{
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        for (const char *at = path; at && *at;) {
            const char *end = strchr(at, SEPARATOR);
            if (try_program(h, at, end ? (size_t)(end - at) : strlen(at), names[i])) return 1;
            at = end ? end + 1 : NULL;
        }
        for (const char *const *folder = usual; *folder; folder++)
            if (try_program(h, *folder, strlen(*folder), names[i])) return 1;
    }
    return 0;
}

int search_interpreter(interpreter *found, int minor, report *why)
{
    hunt h = {found, minor, 0, {NULL, 0, 0}, {NULL, 0, 0}, why};
    char *named = process_environment("TENSEGRITY_PYTHON"), *home = process_environment("PYTHONHOME");
    char *path = process_environment("PATH");
    int done = 0;
    memset(found, 0, sizeof *found);
    if (named) {
        report_add(why, "TENSEGRITY_PYTHON=%s: ", named);
        if (process_exists(named)) done = ask(named, minor, found, &h.seen, why);
        else report_add(why, "there is no such program; ");
    } else {
        if (home) done = try_program(&h, home, strcspn(home, SEPARATOR == ':' ? ":" : ""), HOME_PROGRAM);
        if (!done) done = try_path(&h, path);
        if (!done && !h.asked) report_add(why, "no python3 is in the folders of PATH; ");
    }
    free(h.tried.text);
    free(h.seen.text);
    free(named);
    free(home);
    free(path);
    return done;
}
