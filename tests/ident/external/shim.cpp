// What the tests call through ctypes, and a run of its own for the sanitizers.
#include <stdio.h>

#include <cmath>
#include <limits>

#include "axcomp_external_layer.hpp"

using axcomp::External;

namespace {
const int kAxes = AXCOMP_EXTERNAL_AXES;

struct Registry {
  axcomp::ObjectId seen;
  int left;
  axcomp::Result RegisterObject(axcomp::ObjectId &id, void *) {
    seen = id;
    ++left;
    return 0;
  }
  axcomp::Result UnregisterObject(axcomp::ObjectId &) {
    --left;
    return 0;
  }
};
}  // namespace

extern "C" {

void many(const int64_t *position, int64_t *offset, long rows) {
  for (long k = 0; k < rows; ++k)
    axcomp_external_offsets(position + k * kAxes, offset + k * kAxes);
}

void many_starts(const int64_t *position, int64_t *offset, long rows) {
  for (long k = 0; k < rows; ++k)
    axcomp_external_start_offsets(position + k * kAxes, offset + k * kAxes);
}

External *make() { return new External(); }
void drop(External *one) { delete one; }

// Method 0: initCompensation, 1: computeStartOffsets, 2: computeOffsets. A count of -1 leaves the
// array out.
int32_t call(External *one, int method, int64_t *position, long in, int64_t *offset, long out,
             int64_t *limits, long n_limits, double *values, char *text) {
  axcomp::Cyclic p = axcomp::Cyclic();
  p.cyclic_i = in < 0 ? 0 : position;
  p.dim_cyclic_i = in < 0 ? 0 : in;
  p.cyclic_o = out < 0 ? 0 : offset;
  p.dim_cyclic_o = out < 0 ? 0 : out;
  p.parameters = n_limits < 0 ? 0 : limits;
  p.dim_parameters = n_limits < 0 ? 0 : n_limits;
  const int32_t result = method == 0   ? one->initCompensation(&p)
                         : method == 1 ? one->computeStartOffsets(&p)
                                       : one->computeOffsets(&p);
  values[0] = p.ret_value1;
  values[1] = p.ret_value2;
  for (int k = 0; k < 24; ++k) text[k] = p.ret_text[k];
  return result;
}

int32_t command(External *one, const char *words, double value, double *values, char *text) {
  axcomp::Command s = axcomp::Command();
  for (int k = 0; k < 24; ++k) s.para_string[k] = words[k];
  s.para_value = value;
  const int32_t result = one->writeNcCmd(&s);
  values[0] = s.ret_value1;
  values[1] = s.ret_value2;
  for (int k = 0; k < 24; ++k) text[k] = s.ret_text[k];
  return result;
}

int32_t without_structures(External *one) {
  return one->initCompensation(0) && one->computeStartOffsets(0) && one->computeOffsets(0) &&
         one->writeNcCmd(0);
}

// Type, group, index, and how many registrations are left in the end.
void registered(int32_t *found) {
  Registry registry = Registry();
  int object = 0;
  axcomp::register_object(&registry, &object);
  found[0] = registry.seen.type;
  found[1] = registry.seen.group;
  found[2] = static_cast<int32_t>(registry.seen.index);
  axcomp::unregister_object(&registry);
  found[3] = registry.left;
}
}

#ifdef AXCOMP_MAIN
int main() {
  const int64_t ends[] = {INT64_MIN, INT64_MIN + 1, -9007199254740993, -1, 0, 1, 100000000,
                          9007199254740993, INT64_MAX - 1, INT64_MAX};
  const char *words[] = {"ON", "OFF", "LEVEL", "", "NONSENSE", "123456789012345678901234"};
  const double shares[] = {0.5, 2.0, std::numeric_limits<double>::quiet_NaN()};
  External one;
  uint64_t state = 1;
  int64_t position[kAxes], offset[kAxes], limits[2 * kAxes];
  double values[2];
  char text[24], given[24];
  long failed = 0;
  for (long row = 0; row < 20000; ++row) {
    for (int k = 0; k < kAxes; ++k) {
      state = state * 6364136223846793005u + 1442695040888963407u;
      const int64_t drawn = static_cast<int64_t>(state);
      position[k] = row % 3 == 0 ? drawn : row % 3 == 1 ? drawn / 200000000 : ends[(drawn >> 40 & 1023) % 10];
      limits[2 * k] = row % 2 ? 40000000000 : drawn;
      limits[2 * k + 1] = row % 2 ? 0 : -drawn / 2;
    }
    axcomp_external_offsets(position, offset);
    axcomp_external_start_offsets(position, offset);
    if (row == 7) call(&one, 0, position, kAxes, offset, kAxes, limits, -1, values, text);
    failed += call(&one, 1 + row % 2, position, kAxes - (row % 11 == 0), offset, kAxes, limits,
                   row % 5 ? 2 * kAxes : -1, values, text) != 0;
    for (int k = 0; k < 24; ++k) given[k] = 0;
    for (int k = 0; k < 24 && words[row % 6][k]; ++k) given[k] = words[row % 6][k];
    failed += command(&one, given, shares[row % 3], values, text) != 0;
  }
  printf("%ld\n", failed);
  return without_structures(&one) ? 0 : 1;
}
#endif
