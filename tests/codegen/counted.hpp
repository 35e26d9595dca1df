/* counted.hpp: the generated C, compiled as C++ with a float32 whose operators count. Hand-written; nothing of it knows
 * what is generated. Included before a generated file, in which counted.py has put a word before each &&, ||, ? and
 * condition of a for. */
#ifndef COUNTED_HPP
#define COUNTED_HPP

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#define QUIET __attribute__((no_instrument_function, always_inline)) inline

enum { ADD, MUL, DIV, SQRT, COMPARE, CHOICE, CALL, KINDS };
extern long counts[KINDS];

struct float32 {
    float value;
    float32() = default;
    QUIET float32(float v) : value(v) {}
};

#define COUNTED(kind, result, expression) { counts[kind]++; return result(expression); }
#define BOTH const float32 &a, const float32 &b
QUIET float32 operator+(BOTH) COUNTED(ADD, float32, a.value + b.value)
QUIET float32 operator-(BOTH) COUNTED(ADD, float32, a.value - b.value)
QUIET float32 operator-(const float32 &a) COUNTED(ADD, float32, -a.value)
QUIET float32 operator*(BOTH) COUNTED(MUL, float32, a.value * b.value)
QUIET float32 operator/(BOTH) COUNTED(DIV, float32, a.value / b.value)
QUIET bool operator<(BOTH) COUNTED(COMPARE, bool, a.value < b.value)
QUIET bool operator>(BOTH) COUNTED(COMPARE, bool, a.value > b.value)
QUIET bool operator<=(BOTH) COUNTED(COMPARE, bool, a.value <= b.value)
QUIET bool operator>=(BOTH) COUNTED(COMPARE, bool, a.value >= b.value)
QUIET bool operator==(BOTH) COUNTED(COMPARE, bool, a.value == b.value)
QUIET bool operator!=(BOTH) COUNTED(COMPARE, bool, a.value != b.value)
QUIET float32 counted_root(const float32 &a) COUNTED(SQRT, float32, sqrtf(a.value))
#define PMSM_SQRT(x) counted_root(x)

/* A condition is asked, or a side of && and || and ? : chosen. What stands to the left must be a bool: a number there
 * would mean that the word binds to a part of a condition, and does not compile. */
struct chosen_t {};
QUIET chosen_t chosen() { counts[CHOICE]++; return chosen_t(); }
QUIET bool operator+(bool left, chosen_t) { return left; }
bool operator+(int left, chosen_t) = delete;
bool operator+(float left, chosen_t) = delete;
bool operator+(const float32 &left, chosen_t) = delete;
QUIET int asked() { return (int)++counts[CHOICE]; }

/* The names of the port header, which leaves them alone where this is defined. */
#define DSP28_DATA_TYPES
typedef int16_t int16;
typedef int32_t int32;
typedef uint16_t Uint16;
typedef uint32_t Uint32;

#define if(...) if (asked(), (__VA_ARGS__))
#define while(...) while (asked(), (__VA_ARGS__))

#endif
