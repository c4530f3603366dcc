/* Shared libraries of the process, by the means of each system. */
#define _GNU_SOURCE
#include "python.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT 20000 /* ms, for which another start of Python is waited for */

#if defined(_WIN32)

#include <windows.h>

#include <tlhelp32.h>

library_function library_symbol(void *library, const char *name)
{
    return (library_function)(void *)GetProcAddress((HMODULE)library, name);
}

void *library_of_python(void)
{
    void *found = NULL;
    MODULEENTRY32W entry = {.dwSize = sizeof entry};
    HANDLE modules = CreateToolhelp32Snapshot(TH32CS_SNAPMODULE, GetCurrentProcessId());
    if (modules == INVALID_HANDLE_VALUE) return NULL;
    for (int more = Module32FirstW(modules, &entry); more && !found; more = Module32NextW(modules, &entry))
        if (library_symbol(entry.hModule, "Py_IsInitialized")) found = entry.hModule;
    CloseHandle(modules);
    return found;
}

void *library_open(const char *path, report *why)
{
    wchar_t wide[4096];
    if (!MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 4096)) return NULL;
    void *library = LoadLibraryExW(wide, NULL, LOAD_WITH_ALTERED_SEARCH_PATH);
    if (!library) report_add(why, "%s cannot be loaded (error %lu of Windows)", path, (unsigned long)GetLastError());
    return library;
}

void *library_lock(library_function inside)
{
    wchar_t name[64];
    (void)inside;
    swprintf(name, 64, L"Local\\tensegrity-python-%lu", (unsigned long)GetCurrentProcessId());
    HANDLE mutex = CreateMutexW(NULL, FALSE, name);
    if (mutex) WaitForSingleObject(mutex, LIMIT);
    return mutex;
}

void library_unlock(void *lock)
{
    if (!lock) return;
    ReleaseMutex(lock);
    CloseHandle(lock);
}

#else

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <sys/file.h>
#include <time.h>
#include <unistd.h>

#if defined(__APPLE__)
#include <mach-o/dyld.h>
#else
#include <link.h>
#endif

library_function library_symbol(void *library, const char *name)
{
    library_function function;
    *(void **)&function = dlsym(library, name);
    return function;
}

/* Of a library that was loaded for its user alone, a handle; its names become known to all: Python's extensions need them. */
static void *python_in(const char *path)
{
    const char *base = strrchr(path, '/');
    if (strncmp(base ? base + 1 : path, "libpython", 9) && strncmp(base ? base + 1 : path, "Python", 6)) return NULL;
    void *library = dlopen(path, RTLD_NOW | RTLD_GLOBAL | RTLD_NOLOAD);
    return library && library_symbol(library, "Py_IsInitialized") ? library : NULL;
}

#if defined(__APPLE__)
static void *hidden_python(void)
{
    void *found = NULL;
    for (uint32_t i = 0; i < _dyld_image_count() && !found; i++) found = python_in(_dyld_get_image_name(i));
    return found;
}
#else
static int collect(struct dl_phdr_info *info, size_t size, void *paths)
{
    (void)size;
    if (info->dlpi_name && strstr(info->dlpi_name, "libpython")) report_add(paths, "%s\n", info->dlpi_name);
    return 0;
}

static void *hidden_python(void)
{
    report paths = {NULL, 0, 0};
    void *found = NULL;
    dl_iterate_phdr(collect, &paths);
    for (char *path = paths.text, *end; path && *path && !found; path = end + 1) {
        end = strchr(path, '\n');
        if (!end) break;
        *end = 0;
        found = python_in(path);
    }
    free(paths.text);
    return found;
}
#endif

void *library_of_python(void)
{
    if (library_symbol(RTLD_DEFAULT, "Py_IsInitialized")) return dlopen(NULL, RTLD_NOW | RTLD_GLOBAL);
    return hidden_python();
}

void *library_open(const char *path, report *why)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_GLOBAL);
    if (!library) report_add(why, "%s", dlerror());
    return library;
}

/* Several FMUs may have a copy each of this code, so that a lock of its own would not do: they share the file of Python's
 * library, which can be locked.  So can other processes; one that has been stopped there must not stop this one for ever. */
void *library_lock(library_function inside)
{
    Dl_info info;
    void *address = *(void **)&inside;
    int *lock = malloc(sizeof *lock);
    if (!lock) return NULL;
    *lock = dladdr(address, &info) && info.dli_fname ? open(info.dli_fname, O_RDONLY | O_CLOEXEC) : -1;
    struct timespec pause = {0, 2000000}; /* 2 ms */
    for (int tries = 0; *lock >= 0 && tries < LIMIT / 2; tries++) {
        if (!flock(*lock, LOCK_EX | LOCK_NB) || (errno != EWOULDBLOCK && errno != EINTR)) break;
        nanosleep(&pause, NULL);
    }
    return lock;
}

void library_unlock(void *lock)
{
    if (lock && *(int *)lock >= 0) close(*(int *)lock);
    free(lock);
}

#endif
