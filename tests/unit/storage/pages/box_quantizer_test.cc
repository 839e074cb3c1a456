#include "storage/pages/box_quantizer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <utility>

#include "storage/pages/page_image.h"
#include "tests/support/random.h"

namespace raymill::storage {
namespace {

float plane(const AxisFrame& frame, std::uint8_t q) {
  return decode_plane(frame.base, power_of_two(frame.exponent), q);
}

// The frame reaches over [lower, upper], and quantised planes of anything inside are outward and tight.
void check_frame(float lower, float upper, std::initializer_list<float> values) {
  const AxisFrame frame = choose_frame(lower, upper);
  ASSERT_LE(plane(frame, 0), lower);
  ASSERT_GE(plane(frame, 255), upper);
  for (const float value : values) {
    const auto below = quantize_lower(frame, value), above = quantize_upper(frame, value);
    ASSERT_TRUE(below && above) << lower << " " << upper << " " << value;
    EXPECT_LE(plane(frame, *below), value);
    EXPECT_GE(plane(frame, *above), value);
    if (*below < 255) {
      EXPECT_GT(plane(frame, static_cast<std::uint8_t>(*below + 1)), value) << "the plane above is as good";
    }
    if (*above > 0) {
      EXPECT_LT(plane(frame, static_cast<std::uint8_t>(*above - 1)), value) << "the plane below is as good";
    }
  }
}

TEST(BoxQuantizer, DecodedPlanesHoldTheBoxAtEveryScaleAndOffset) {
  tests::Random random(1);
  for (const float scale : {1e-45F, 1e-38F, 1e-20F, 1e-3F, 1.0F, 1e6F, 1e20F, 1e36F}) {
    for (const float offset : {0.0F, 1.0F, -1.0F, 16777216.0F, 1e30F, -1e36F}) {
      for (int i = 0; i < 200; ++i) {
        float a = offset + random.uniform(-1, 1) * scale, b = offset + random.uniform(-1, 1) * scale;
        if (b < a) {
          std::swap(a, b);
        }
        const float middle = std::clamp(a + (b - a) * random.uniform(0, 1), a, b);
        ASSERT_NO_FATAL_FAILURE(check_frame(a, b, {a, b, middle})) << scale << " " << offset;
      }
    }
  }
}

TEST(BoxQuantizer, AnyTwoFiniteFloatsMakeAFrame) {
  tests::Random random(2);
  for (int i = 0; i < 20000; ++i) {
    float a = std::bit_cast<float>(static_cast<std::uint32_t>(random.next()));
    float b = std::bit_cast<float>(static_cast<std::uint32_t>(random.next()));
    if (!std::isfinite(a) || !std::isfinite(b)) {
      continue;
    }
    if (b < a) {
      std::swap(a, b);
    }
    ASSERT_NO_FATAL_FAILURE(check_frame(a, b, {a, b})) << a << " " << b;
  }
}

TEST(BoxQuantizer, ExtremesHold) {
  constexpr float kMax = std::numeric_limits<float>::max(), kDenormal = std::numeric_limits<float>::denorm_min();
  check_frame(-kMax, kMax, {-kMax, kMax, 0.0F, 1.0F});
  check_frame(kMax, kMax, {kMax});
  check_frame(0, kDenormal, {0.0F, kDenormal});
  check_frame(-kDenormal, 0, {-kDenormal, 0.0F, -0.0F});
  check_frame(-0.0F, 0.0F, {-0.0F, 0.0F});
  check_frame(5, 5, {5.0F});
  // One ulp wide, far out: 256 planes fit into no float between the two.
  check_frame(16777216.0F, std::nextafter(16777216.0F, kMax), {16777216.0F, std::nextafter(16777216.0F, kMax)});
}

TEST(BoxQuantizer, FrameIsTheSmallestPowerOfTwo) {
  const AxisFrame frame = choose_frame(0, 255);
  EXPECT_EQ(frame.exponent, 0);
  EXPECT_EQ(choose_frame(0, 256).exponent, 1);
  EXPECT_EQ(choose_frame(10, 10).exponent, -126);
}

TEST(BoxQuantizer, ValuesOutsideTheFrameHaveNoPlane) {
  const AxisFrame frame = choose_frame(0, 1);
  EXPECT_FALSE(quantize_lower(frame, -1));
  EXPECT_FALSE(quantize_upper(frame, 1000));
}

TEST(BoxQuantizer, PowerOfTwoIsExactOverItsWholeRange) {
  for (int exponent = -126; exponent <= 127; ++exponent) {
    EXPECT_EQ(power_of_two(exponent), std::ldexp(1.0F, exponent));
  }
}

}  // namespace
}  // namespace raymill::storage
