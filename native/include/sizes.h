/* Sizes of what a library and Python hand each other, which `native.loading` compares. */
#ifndef SIZES_H
#define SIZES_H

#include <stdint.h>

#define EXPORTED __attribute__((visibility("default")))
#define SIZE_OF(structure) EXPORTED const int64_t size_of_##structure = sizeof(structure)

#endif
