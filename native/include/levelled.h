/* Names of what is compiled once for every kind of processor, as LEVEL says: NAMED(f) is f_avx2. */
#ifndef LEVELLED_H
#define LEVELLED_H

#define JOINED_(a, b) a##_##b
#define JOINED(a, b) JOINED_(a, b)
#define NAMED(name) JOINED(name, LEVEL)

#endif
