/* What a library shows; of this `native.headers` reads what Python calls. */
#ifndef EXPORTED_H
#define EXPORTED_H

#define EXPORTED __attribute__((visibility("default")))

/* Names of what is compiled once for every kind of processor, as LEVEL says: NAMED(f) is f_avx2. */
#define JOINED_(a, b) a##_##b
#define JOINED(a, b) JOINED_(a, b)
#define NAMED(name) JOINED(name, LEVEL)

#endif
