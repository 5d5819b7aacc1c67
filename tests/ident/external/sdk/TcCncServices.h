// Stand-in: what [003] 5.3 says of the registration, and a few names of Windows.
#ifndef STAND_IN_SERVICES_H
#define STAND_IN_SERVICES_H
#include <stdint.h>
#define __int64 long  // 64 bits here, as long long is on the controller
#define TCOMAPI
typedef int32_t HRESULT;
struct TcCncRegisterObject {
  uint16_t type, group;
  uint32_t index;
};
#endif
