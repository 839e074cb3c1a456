// raymill-image RAW FORMAT OUTPUT: writes a raw picture (raw_image.h) as exr or png by OpenImageIO.
// raymill-image alpha FILE: writes a picture's alpha to stdout (alpha.h).
// A program of its own, because OpenImageIO brings hundreds of shared objects and 120 MB into a process.

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "client/cli/image/alpha.h"
#include "client/cli/image/raw_image.h"

namespace {

using raymill::client::kRawImageMagic;
using raymill::client::RawImageHeader;
using raymill::client::Tone;

constexpr std::uint32_t kMaxSidePixels = 65536;

int fail(const std::string& sentence) {
  std::fprintf(stderr, "%s\n", sentence.c_str());
  return 1;
}

// IEC 61966-2-1.
float srgb(float linear) {
  const float x = std::clamp(linear, 0.0F, 1.0F);
  return x <= 0.0031308F ? 12.92F * x : 1.055F * std::pow(x, 1 / 2.4F) - 0.055F;
}

// Narkowicz's fit of the ACES filmic curve (2015).
float filmic(float x) { return x * (2.51F * x + 0.03F) / (x * (2.43F * x + 0.59F) + 0.14F); }

float displayed(float value, const RawImageHeader& header) {
  switch (header.tone) {
    case Tone::distance: {
      if (!std::isfinite(value)) {
        return 0;
      }
      const float range = std::log(std::max(header.high, 1e-30F) / std::max(header.low, 1e-30F));
      const float place = range > 0 ? std::log(std::max(value, 1e-30F) / std::max(header.low, 1e-30F)) / range : 0;
      return 1 - 0.9F * std::clamp(place, 0.0F, 1.0F);
    }
    case Tone::direction:
      return 0.5F + 0.5F * value;
    case Tone::linear:
      return srgb(value);
    case Tone::radiance:
      return srgb(filmic(value));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && argv[1] == std::string("alpha")) {
    std::string sentence;
    return raymill::client::write_alpha(argv[2], sentence) ? 0 : fail(sentence);
  }
  if (argc != 4) {
    return fail("usage: raymill-image RAW exr|png OUTPUT, or raymill-image alpha FILE");
  }
  const std::string format = argv[2];
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> raw(std::fopen(argv[1], "rb"), &std::fclose);
  RawImageHeader header;
  if (!raw || std::fread(&header, sizeof header, 1, raw.get()) != 1 || header.magic != kRawImageMagic ||
      header.width - 1 >= kMaxSidePixels || header.height - 1 >= kMaxSidePixels ||
      (header.channels != 1 && header.channels != 3)) {
    return fail(std::string("cannot read the raw picture ") + argv[1]);
  }
  const auto output = OIIO::ImageOutput::create(format);
  if (!output) {
    return fail("OpenImageIO cannot write " + format + ": " + OIIO::geterror());
  }
  const bool is_float = format == "exr";
  OIIO::ImageSpec spec(static_cast<int>(header.width), static_cast<int>(header.height),
                       static_cast<int>(header.channels), is_float ? OIIO::TypeDesc::FLOAT : OIIO::TypeDesc::UINT8);
  if (is_float) {
    spec.attribute("compression", "zip");
    // The time of writing would make equal pictures differ.
    spec.attribute("DateTime", "1970:01:01 00:00:00");
    if (header.channels == 1) {
      spec.channelnames = {header.tone == Tone::distance ? "Z" : "Y"};
    }
  } else {
    spec.attribute("oiio:ColorSpace", "sRGB");
  }
  if (!output->open(argv[3], spec)) {
    return fail("cannot write the picture: " + output->geterror());
  }
  std::vector<float> row(std::size_t{header.width} * header.channels);
  for (std::uint32_t y = 0; y < header.height; ++y) {
    if (std::fread(row.data(), sizeof(float), row.size(), raw.get()) != row.size()) {
      return fail(std::string("the raw picture ") + argv[1] + " ends early");
    }
    if (!is_float) {
      for (float& value : row) {
        value = displayed(value, header);
      }
    }
    if (!output->write_scanline(static_cast<int>(y), 0, OIIO::TypeDesc::FLOAT, row.data())) {
      return fail("cannot write the picture: " + output->geterror());
    }
  }
  return output->close() ? 0 : fail("cannot write the picture: " + output->geterror());
}
