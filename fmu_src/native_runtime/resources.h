/* Files of the FMU's resources folder, which the host names by a URI. */
#ifndef TENSEGRITY_RESOURCES_H
#define TENSEGRITY_RESOURCES_H

#include <stddef.h>
#include <stdint.h>

/* Path of a file in the resources, in UTF-8 or as the URI has its bytes, malloc'ed; NULL: out of memory. */
char *fmu_resource_path(const char *location, const char *file);

/* The whole of a file in the resources, with a 0 behind it, malloc'ed; NULL with the reason in message. */
char *fmu_resource(const char *location, const char *file, size_t *size, char *message, size_t capacity);

/* 64-bit FNV-1a of bytes, going on from another sum; FMU_CHECKSUM begins one.  Each byte enters by a one-to-one step, so a change
 * of any single byte changes the sum for certain; other damage passes once in 2^64 times. */
#define FMU_CHECKSUM 14695981039346656037u
uint64_t fmu_checksum(uint64_t sum, const char *bytes, size_t size);

#endif
