// Stand-in: the interface that [003] 5.3 names.
#ifndef STAND_IN_CNC_H
#define STAND_IN_CNC_H
#include "TcCncServices.h"
struct ITcUnknown { virtual ~ITcUnknown() {} };
struct Registry : public ITcUnknown {
  virtual HRESULT TCOMAPI RegisterObject(TcCncRegisterObject &id, ITcUnknown *ipUnk) = 0;
  virtual HRESULT TCOMAPI UnregisterObject(TcCncRegisterObject &id) = 0;
};
#endif
