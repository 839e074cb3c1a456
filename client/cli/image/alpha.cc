#include "client/cli/image/alpha.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <vector>

#include "storage/import/alpha_stream.h"

namespace raymill::client {
namespace {

using storage::AlphaStreamHead;

// OpenImageIO's messages may have lines.
std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text.empty() ? "OpenImageIO does not say why" : text;
}

// Rows that are read at once: one, or those of a row of tiles.
std::vector<std::byte> read_rows(OIIO::ImageInput& input, const OIIO::ImageSpec& spec, OIIO::TypeDesc type, int y,
                                 int rows, bool& good) {
  std::vector<std::byte> values(static_cast<std::size_t>(rows) * static_cast<std::size_t>(spec.width) * type.size());
  const int first = spec.y + y, channel = spec.alpha_channel;
  good = spec.tile_width > 0
             ? input.read_tiles(0, 0, spec.x, spec.x + spec.width, first, first + rows, spec.z, spec.z + 1, channel,
                                channel + 1, type, values.data())
             : input.read_scanlines(0, 0, first, first + rows, spec.z, channel, channel + 1, type, values.data());
  return values;
}

}  // namespace

bool write_alpha(const std::string& path, std::string& sentence) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) {
    sentence = "there is no such file";
    return false;
  }
  const auto input = OIIO::ImageInput::open(path);
  if (!input) {
    sentence = one_line(OIIO::geterror());
    return false;
  }
  const OIIO::ImageSpec& spec = input->spec();
  if (spec.width < 1 || spec.height < 1 || spec.deep || spec.depth > 1) {
    sentence = "it is no flat picture";
    return false;
  }
  // 8 bits or fewer become 8, all others 16.
  const bool bytes = spec.format.size() == 1;
  AlphaStreamHead head;
  head.width = static_cast<std::uint32_t>(spec.width);
  head.height = static_cast<std::uint32_t>(spec.height);
  head.value_bytes = spec.alpha_channel < 0 ? 0 : bytes ? 1 : 2;
  bool written = std::fwrite(&head, sizeof head, 1, stdout) == 1;
  const int step = std::max(1, spec.tile_height);
  const OIIO::TypeDesc type = bytes ? OIIO::TypeDesc::UINT8 : OIIO::TypeDesc::UINT16;
  for (int y = 0; written && head.value_bytes > 0 && y < spec.height; y += step) {
    bool good = false;
    const std::vector<std::byte> rows = read_rows(*input, spec, type, y, std::min(step, spec.height - y), good);
    if (!good) {
      sentence = one_line(input->geterror());
      return false;
    }
    written = std::fwrite(rows.data(), 1, rows.size(), stdout) == rows.size();
  }
  if (!written || std::fflush(stdout) != 0) {
    sentence = "whoever asked for its texels has gone";
    return false;
  }
  return true;
}

}  // namespace raymill::client
