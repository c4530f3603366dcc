/* Files of the FMU's resources folder, which the host names by a URI. */
#include "instance.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#include <windows.h>
#endif

static int hex(char c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* file:///a%20b, file:/a%20b and file://host/a%20b -> /a b (UTF-8); anything else is taken for a path. */
static void decode(const char *uri, char *path)
{
    if (strncmp(uri, "file:", 5)) {
        strcpy(path, uri);
        return;
    }
    uri += 5;
    if (!strncmp(uri, "//", 2)) {
        uri += 2;
        while (*uri && *uri != '/') uri++;
    }
#if defined(_WIN32)
    if (uri[0] == '/' && uri[1] && uri[2] == ':') uri++; /* /C:/... */
#endif
    while (*uri) {
        int high = uri[0] == '%' ? hex(uri[1]) : -1, low = high >= 0 ? hex(uri[2]) : -1;
        *path++ = low >= 0 ? (char)(16 * high + low) : *uri;
        uri += low >= 0 ? 3 : 1;
    }
    *path = 0;
}

static FILE *open_file(const char *path)
{
#if defined(_WIN32)
    int n = MultiByteToWideChar(CP_UTF8, 0, path, -1, NULL, 0);
    wchar_t *wide = malloc(sizeof *wide * (size_t)(n > 0 ? n : 1));
    FILE *file = NULL;
    if (wide && n > 0 && MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, n)) file = _wfopen(wide, L"rb");
    free(wide);
    return file;
#else
    return fopen(path, "rb");
#endif
}

static char *read_all(FILE *file, size_t *size)
{
    long length = -1;
    if (!fseek(file, 0, SEEK_END)) length = ftell(file);
    if (length < 0 || fseek(file, 0, SEEK_SET)) return NULL;
    char *bytes = malloc((size_t)length + 1);
    if (!bytes) return NULL;
    *size = fread(bytes, 1, (size_t)length, file);
    if (*size == (size_t)length) return bytes;
    free(bytes);
    return NULL;
}

char *fmu_resource(const char *location, const char *name, size_t *size, char *message, size_t capacity)
{
    char *path = malloc(strlen(location) + strlen(name) + 2), *bytes = NULL;
    if (!path) {
        snprintf(message, capacity, "out of memory");
        return NULL;
    }
    decode(location, path);
    size_t length = strlen(path);
    if (length && path[length - 1] != '/' && path[length - 1] != '\\') strcat(path, "/");
    strcat(path, name);
    FILE *file = open_file(path);
    if (file) {
        bytes = read_all(file, size);
        fclose(file);
    }
    const char *remedy = "unzip the FMU anew, and pass the URI of its resources folder";
    if (!bytes) snprintf(message, capacity, "%s cannot be read; %s", path, remedy);
    free(path);
    return bytes;
}
