// The module that a user makes of the sample: each method one line, as the README says.
#include "axcomp_external_layer.hpp"

namespace {
const int kAxes = AXCOMP_EXTERNAL_AXES;

class Module : public Compensation {
 public:
  virtual HRESULT TCOMAPI initCompensation(PTcMcComExtCompParameter p) {
    return m_compensation.initCompensation(p);
  }
  virtual HRESULT TCOMAPI computeStartOffsets(PTcMcComExtCompParameter p) {
    return m_compensation.computeStartOffsets(p);
  }
  virtual HRESULT TCOMAPI computeOffsets(PTcMcComExtCompParameter p) {
    return m_compensation.computeOffsets(p);
  }
  virtual HRESULT TCOMAPI writeNcCmd(PTcMcComCmdParameter s) { return m_compensation.writeNcCmd(s); }

 private:
  axcomp::External m_compensation;
};

struct Cnc : public Registry {
  int seen;
  virtual HRESULT TCOMAPI RegisterObject(TcCncRegisterObject &id, ITcUnknown *) {
    seen = id.type;
    return 0;
  }
  virtual HRESULT TCOMAPI UnregisterObject(TcCncRegisterObject &) { return 0; }
};
}  // namespace

// Offsets of some cycles by way of the module; the type that it registers as, or -1 on an error.
extern "C" int cycles(int64_t *position, int64_t *offset, long rows) {
  Module module;
  Cnc cnc;
  TcMcComExtCompParameter p = TcMcComExtCompParameter();
  p.dim_cyclic_i = p.dim_cyclic_o = kAxes;
  p.cyclic_i = position;
  p.cyclic_o = offset;
  if (axcomp::register_object(&cnc, &module) || module.initCompensation(&p)) return -1;
  for (long k = 0; k < rows; ++k) {
    p.cyclic_i = position + k * kAxes;
    p.cyclic_o = offset + k * kAxes;
    if (module.computeOffsets(&p)) return -1;
  }
  TcMcComCmdParameter s = TcMcComCmdParameter();
  return module.writeNcCmd(&s) || axcomp::unregister_object(&cnc) ? -1 : cnc.seen;
}
