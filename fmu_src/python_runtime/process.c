/* Asking another program, and the environment, by the means of each system. */
#define _GNU_SOURCE
#include "python.h"

#include <stdlib.h>
#include <string.h>

#define LIMIT 20000 /* ms */

#if defined(_WIN32)

#include <windows.h>

wchar_t *process_wide(const char *text)
{
    int n = MultiByteToWideChar(CP_UTF8, 0, text, -1, NULL, 0);
    wchar_t *found = n > 0 ? malloc(sizeof *found * (size_t)n) : NULL;
    if (found) MultiByteToWideChar(CP_UTF8, 0, text, -1, found, n);
    return found;
}

char *process_environment(const char *name)
{
    wchar_t *key = process_wide(name);
    DWORD n = key ? GetEnvironmentVariableW(key, NULL, 0) : 0;
    wchar_t *value = n > 1 ? malloc(sizeof *value * n) : NULL;
    char *text = NULL;
    if (value && GetEnvironmentVariableW(key, value, n) < n) {
        int size = WideCharToMultiByte(CP_UTF8, 0, value, -1, NULL, 0, NULL, NULL);
        if (size > 0 && (text = malloc((size_t)size))) WideCharToMultiByte(CP_UTF8, 0, value, -1, text, size, NULL, NULL);
    }
    free(value);
    free(key);
    return text;
}

int process_exists(const char *path)
{
    wchar_t *name = process_wide(path);
    DWORD found = name ? GetFileAttributesW(name) : INVALID_FILE_ATTRIBUTES;
    free(name);
    return found != INVALID_FILE_ATTRIBUTES && !(found & FILE_ATTRIBUTE_DIRECTORY);
}

char *process_target(const char *path) { return text_copy(path); } /* programs are copied here, not linked */

/* No argument here holds a quotation mark. */
static wchar_t *command_line(const char *program, const char *first, const char *second)
{
    report line = {NULL, 0, 0};
    report_add(&line, "\"%s\" %s \"%s\"", program, first, second);
    wchar_t *found = line.text ? process_wide(line.text) : NULL;
    free(line.text);
    return found;
}

static ptrdiff_t read_pipe(HANDLE process, HANDLE from, char *output, size_t capacity)
{
    DWORD got = 0, size = 0;
    if (WaitForSingleObject(process, LIMIT) != WAIT_OBJECT_0) { /* the pipe holds more than Python says */
        TerminateProcess(process, 1);
        return -1;
    }
    while (size < capacity && ReadFile(from, output + size, (DWORD)(capacity - size), &got, NULL) && got) size += got;
    return (ptrdiff_t)size;
}

ptrdiff_t process_output(const char *program, const char *first, const char *second, char *output, size_t capacity)
{
    SECURITY_ATTRIBUTES inherited = {sizeof inherited, NULL, TRUE};
    STARTUPINFOW start = {.cb = sizeof start, .dwFlags = STARTF_USESTDHANDLES};
    PROCESS_INFORMATION child;
    HANDLE from, to;
    wchar_t *line = command_line(program, first, second);
    ptrdiff_t size = -1;
    if (line && CreatePipe(&from, &to, &inherited, (DWORD)capacity)) {
        SetHandleInformation(from, HANDLE_FLAG_INHERIT, 0);
        start.hStdOutput = to;
        int runs = CreateProcessW(NULL, line, NULL, NULL, TRUE, CREATE_NO_WINDOW, NULL, NULL, &start, &child);
        CloseHandle(to);
        if (runs) {
            size = read_pipe(child.hProcess, from, output, capacity);
            CloseHandle(child.hThread);
            CloseHandle(child.hProcess);
        }
        CloseHandle(from);
    }
    free(line);
    return size;
}

#else

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#if defined(__APPLE__)
#include <crt_externs.h>
#define ENVIRONMENT (*_NSGetEnviron())
#else
extern char **environ;
#define ENVIRONMENT environ
#endif

char *process_environment(const char *name)
{
    const char *value = getenv(name);
    return value && *value ? text_copy(value) : NULL;
}

int process_exists(const char *path)
{
    struct stat found;
    return !stat(path, &found) && S_ISREG(found.st_mode) && !access(path, X_OK);
}

char *process_target(const char *path) { return realpath(path, NULL); }

static long now(void) /* ms */
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (long)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* All that comes through the pipe, -1 where that takes too long. */
static ptrdiff_t read_pipe(int from, char *output, size_t capacity)
{
    size_t size = 0;
    long end = now() + LIMIT;
    for (;;) {
        struct pollfd ready = {from, POLLIN, 0};
        long left = end - now();
        int found = left > 0 ? poll(&ready, 1, (int)left) : 0;
        if (found < 0 && errno == EINTR) continue;
        if (found <= 0) return -1;
        char rest[512]; /* what has no room is read all the same, so that the program ends */
        ssize_t got = size < capacity ? read(from, output + size, capacity - size) : read(from, rest, sizeof rest);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return got < 0 ? -1 : (ptrdiff_t)size;
        if (size < capacity) size += (size_t)got;
    }
}

ptrdiff_t process_output(const char *program, const char *first, const char *second, char *output, size_t capacity)
{
    int ends[2];
    pid_t child;
    char *words[] = {(char *)program, (char *)first, (char *)second, NULL};
    posix_spawn_file_actions_t actions;
    if (pipe(ends)) return -1;
    fcntl(ends[0], F_SETFD, FD_CLOEXEC);
    fcntl(ends[1], F_SETFD, FD_CLOEXEC);
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, ends[1], 1);
    posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
    int failed = posix_spawn(&child, program, &actions, NULL, words, ENVIRONMENT);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    ptrdiff_t size = failed ? -1 : read_pipe(ends[0], output, capacity);
    close(ends[0]);
    if (failed) return -1;
    if (size < 0) kill(child, SIGKILL);
    while (waitpid(child, NULL, 0) < 0 && errno == EINTR) {
    }
    return size;
}

#endif
