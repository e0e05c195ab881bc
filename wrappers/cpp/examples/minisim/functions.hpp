// Sine and cosine with the same bits everywhere: docs/decisions/002-arithmetic.md.
#pragma once

#include <cfloat>

namespace minisim {

static_assert(FLT_EVAL_METHOD == 0, "a float is to stay one between two operations");

/// sin(pi * r) for r in -0.5..0.5.
inline float half_wave(float r) {
  constexpr float s0 = 0x1.921fb6p+1F;
  constexpr float s1 = -0x1.4abbb6p+2F;
  constexpr float s2 = 0x1.466758p+1F;
  constexpr float s3 = -0x1.3232fcp-1F;
  constexpr float s4 = 0x1.3c4b36p-4F;
  const float z = r * r;
  const float p = (((s4 * z + s3) * z + s2) * z + s1) * z + s0;
  float s = r * p;
  s = s > 1.0F ? 1.0F : s;
  return s < -1.0F ? -1.0F : s;
}

/// sin(pi * a) for a in -1..1.
inline float sin_pi(float a) {
  float r = a > 0.5F ? 1.0F - a : a;
  r = a < -0.5F ? -1.0F - a : r;
  return half_wave(r);
}

/// cos(pi * a) for a in -1..1.
inline float cos_pi(float a) {
  const float b = a < 0.0F ? -a : a;
  return half_wave(0.5F - b);
}

}  // namespace minisim
