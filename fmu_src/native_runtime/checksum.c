/* A checksum of files and states: 64-bit FNV-1a.  Each byte enters by a one-to-one step, so a change of any single byte, and so
 * of any bits in it, changes the sum for certain; other damage passes once in 2^64 times. */
#include "instance.h"

uint64_t fmu_checksum(uint64_t sum, const char *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++) sum = (sum ^ (unsigned char)bytes[i]) * 1099511628211u;
    return sum;
}
