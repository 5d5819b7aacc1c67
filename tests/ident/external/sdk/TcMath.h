// Stand-in: functions of the SDK for real time, by their names alone.
#ifndef TCMATH_H
#define TCMATH_H
#include <math.h>
#define STAND_IN(name) static inline double name##_(double x) { return name(x); }
#define STAND_IN_2(name) static inline double name##_(double x, double y) { return name(x, y); }
STAND_IN(fabs) STAND_IN(floor) STAND_IN(ceil) STAND_IN(sqrt) STAND_IN(exp) STAND_IN(log)
STAND_IN(sin) STAND_IN(cos) STAND_IN(tan) STAND_IN(asin) STAND_IN(acos) STAND_IN(atan)
STAND_IN_2(fmod) STAND_IN_2(pow) STAND_IN_2(atan2)
#endif
