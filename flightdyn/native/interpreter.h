/* What is called of Python and of JSBSim, whose interface is Python's: by addresses that Python
   hands over (`ticks.py`), so that no header of it is needed. Python's lock has to be held. */
#ifndef INTERPRETER_H
#define INTERPRETER_H

#include <stddef.h>
#include <stdint.h>

typedef void *Object; /* of Python's, which whoever sets it keeps alive */

typedef struct { /* of the interpreter */
    void *(*call)(void *callable, void *const *arguments, size_t count, void *names);
    double (*value)(void *number); /* -1 where it is none, with an error set */
    void *(*error)(void);          /* NULL where none is set */
    void *(*number)(double value);
    void (*release)(void *object);
} Interpreter;

/* A number that JSBSim hands out, in SI units: (get() - offset) scale. */
typedef struct {
    Object get;
    double offset, scale;
} Gauge;

/* Each of these returns whether it went well; where not, Python has an error set. */

static inline int call(const Interpreter *python, void *callable)
{
    void *answer = python->call(callable, NULL, 0, NULL);
    if (answer) python->release(answer);
    return answer != NULL;
}

static inline int set(const Interpreter *python, void *setter, double value)
{
    void *number = python->number(value);
    if (!number) return 0;
    void *answer = python->call(setter, &number, 1, NULL);
    python->release(number);
    if (answer) python->release(answer);
    return answer != NULL;
}

static inline int read_gauges(const Interpreter *python, const Gauge *gauges, int64_t count,
                       double *values)
{
    for (int64_t i = 0; i < count; i++) {
        void *number = python->call(gauges[i].get, NULL, 0, NULL);
        if (!number) return 0;
        const double value = python->value(number);
        python->release(number);
        if (value == -1.0 && python->error()) return 0;
        values[i] = (value - gauges[i].offset) * gauges[i].scale;
    }
    return 1;
}

#endif
