/* Files of the FMU's resources folder, which the host names by a URI. */
#include "resources.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#include <windows.h>
#endif

/* No resource is larger; of a folder, the C library may say anything. */
#define MOST 0x3fffffffL

static int hex(char c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

static int is_scheme(const char *uri)
{
    static const char scheme[] = "file:";
    for (int i = 0; scheme[i]; i++)
        if ((uri[i] | 32) != (scheme[i] | 32)) return 0;
    return 1;
}

static void percent_decode(const char *uri, char *path)
{
    while (*uri) {
        int high = uri[0] == '%' ? hex(uri[1]) : -1, low = high >= 0 ? hex(uri[2]) : -1;
        *path++ = low >= 0 ? (char)(16 * high + low) : *uri;
        uri += low >= 0 ? 3 : 1;
    }
    *path = 0;
}

static int is_drive(const char *path) { return ((path[0] | 32) >= 'a' && (path[0] | 32) <= 'z') && path[1] == ':'; }

/* file:///a%20b, file:/a%20b and file://localhost/a%20b -> /a b (UTF-8); on Windows file:///C:/a and file://C:/a -> C:/a,
 * file://host/a -> //host/a; what is no URI is taken for a path. */
static void decode(const char *uri, char *path, int windows)
{
    if (!is_scheme(uri)) {
        strcpy(path, uri);
        return;
    }
    percent_decode(uri + 5, path);
    size_t start = 0;
    if (!strncmp(path, "//", 2)) {
        size_t host = strcspn(path + 2, "/");
        if (windows && is_drive(path + 2)) start = 2;
        else if (!windows || host == 0 || (host == 9 && !strncmp(path + 2, "localhost", 9))) start = 2 + host;
    }
    if (windows && path[start] == '/' && is_drive(path + start + 1)) start++;
    memmove(path, path + start, strlen(path + start) + 1);
}

static FILE *open_file(const char *path)
{
#if defined(_WIN32)
    int n = MultiByteToWideChar(CP_UTF8, 0, path, -1, NULL, 0);
    wchar_t *wide = (wchar_t *)malloc(sizeof *wide * (size_t)(n > 0 ? n : 1));
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
    if (length < 0 || length > MOST || fseek(file, 0, SEEK_SET)) return NULL;
    char *bytes = (char *)malloc((size_t)length + 1);
    if (!bytes) return NULL;
    *size = fread(bytes, 1, (size_t)length, file);
    bytes[*size] = 0;
    if (*size == (size_t)length) return bytes;
    free(bytes);
    return NULL;
}

char *fmu_resource_path(const char *location, const char *name)
{
    char *path = (char *)malloc(strlen(location) + strlen(name) + 2);
    if (!path) return NULL;
#if defined(_WIN32)
    decode(location, path, 1);
#else
    decode(location, path, 0);
#endif
    size_t length = strlen(path);
    if (length && path[length - 1] != '/' && path[length - 1] != '\\') strcat(path, "/");
    return strcat(path, name);
}

char *fmu_resource(const char *location, const char *name, size_t *size, char *message, size_t capacity)
{
    char *path = fmu_resource_path(location, name), *bytes = NULL;
    if (!path) {
        snprintf(message, capacity, "out of memory");
        return NULL;
    }
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

uint64_t fmu_checksum(uint64_t sum, const char *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++) sum = (sum ^ (unsigned char)bytes[i]) * 1099511628211u;
    return sum;
}
