// Stand-in: the shapes that [003] 5.1 and 5.2 describe.
#ifndef STAND_IN_INTERFACES_H
#define STAND_IN_INTERFACES_H
#include "TcCncInterfaces.h"
enum eMcComExtCompParameter { kStandard };

struct TcMcComBase {
  double ret_value1, ret_value2;
  char ret_text[24];
};
struct TcMcComExtCompParameter : public TcMcComBase {
  eMcComExtCompParameter type;
  signed __int64 *cyclic_i;
  long dim_cyclic_i;
  signed __int64 *cyclic_o;
  long dim_cyclic_o;
  signed __int64 *parameters;
  long dim_parameters;
};
struct TcMcComCmdParameter : public TcMcComBase {
  char para_string[24];
  double para_value;
};
typedef TcMcComExtCompParameter *PTcMcComExtCompParameter;
typedef TcMcComCmdParameter *PTcMcComCmdParameter;
struct Compensation : public ITcUnknown {
  virtual HRESULT TCOMAPI computeStartOffsets(PTcMcComExtCompParameter p) = 0;
  virtual HRESULT TCOMAPI computeOffsets(PTcMcComExtCompParameter p) = 0;
  virtual HRESULT TCOMAPI writeNcCmd(PTcMcComCmdParameter s) = 0;
  virtual HRESULT TCOMAPI initCompensation(PTcMcComExtCompParameter p) = 0;
};
#endif
