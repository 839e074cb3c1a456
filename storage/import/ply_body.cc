#include "storage/import/ply_body.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "storage/base/quotes.h"
#include "storage/import/byte_window.h"
#include "storage/import/message.h"
#include "storage/import/text_reader.h"

namespace raymill::storage {

namespace {

Status ends_early(const Status& read) {
  return read.ok() ? bad_scene("the file ends; it is damaged or was cut short") : read;
}

template <typename T>
double number_at(const std::byte* bytes, bool turned) {
  std::array<std::byte, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes, sizeof(T));
  if (turned) {
    std::reverse(raw.begin(), raw.end());
  }
  T value;
  std::memcpy(&value, raw.data(), sizeof(T));
  return static_cast<double>(value);
}

class BinaryBody final : public PlyBody {
 public:
  BinaryBody(const ByteSource& file, const PlyHeader& header)
      : window_(file, header.body_offset), turned_(header.encoding == PlyEncoding::big_endian) {}

  Status read(PlyType type, std::span<double> out) override {
    switch (type) {
      case PlyType::int8:
        return read_as<std::int8_t>(out);
      case PlyType::uint8:
        return read_as<std::uint8_t>(out);
      case PlyType::int16:
        return read_as<std::int16_t>(out);
      case PlyType::uint16:
        return read_as<std::uint16_t>(out);
      case PlyType::int32:
        return read_as<std::int32_t>(out);
      case PlyType::uint32:
        return read_as<std::uint32_t>(out);
      case PlyType::float32:
        return read_as<float>(out);
      case PlyType::float64:
        break;
    }
    return read_as<double>(out);
  }

  Status skip(PlyType type, std::uint64_t count) override {
    const std::uint64_t most = std::numeric_limits<std::uint64_t>::max() / size_bytes(type);
    return count <= most && window_.skip(count * size_bytes(type)) ? Status() : ends_early({});
  }

 private:
  template <typename T>
  Status read_as(std::span<double> out) {
    constexpr std::size_t kPiece = ByteWindow::kMostPeek / sizeof(T);
    while (!out.empty()) {
      const std::size_t taken = std::min(kPiece, out.size());
      const std::span<const std::byte> bytes = window_.peek(taken * sizeof(T));
      if (bytes.size() < taken * sizeof(T)) {
        return ends_early(window_.status());
      }
      for (std::size_t i = 0; i < taken; ++i) {
        out[i] = number_at<T>(bytes.data() + i * sizeof(T), turned_);
      }
      window_.take(taken * sizeof(T));
      out = out.subspan(taken);
    }
    return {};
  }

  ByteWindow window_;
  const bool turned_;
};

// Rows end where their numbers do, lines say nothing: so do the readers of others.
class TextBody final : public PlyBody {
 public:
  TextBody(const ByteSource& file, const PlyHeader& header, Reals reals)
      : text_(file, header.body_offset, {}), reals_(reals) {}

  Status read(PlyType type, std::span<double> out) override {
    for (double& value : out) {
      const std::string_view word = text_.word_of_any_line();
      if (word.empty()) {
        return ends_early(text_.status());
      }
      if (!(is_integer(type) ? parse_whole_number(word, value) : parse_real(word, value))) {
        return bad_scene("line ", text_.line(), " after its header has ", in_quotes(word.substr(0, 40)), " for a ",
                         is_integer(type) ? "whole number" : "number");
      }
    }
    return {};
  }

  Status skip(PlyType, std::uint64_t count) override {
    for (; count != 0; --count) {
      if (text_.word_of_any_line().empty()) {
        return ends_early(text_.status());
      }
    }
    return {};
  }

 private:
  static bool parse_whole_number(std::string_view word, double& value) {
    std::int64_t number = 0;
    const bool good = parse_integer(word, number);
    value = static_cast<double>(number);
    return good;
  }
  [[nodiscard]] bool parse_real(std::string_view word, double& value) const {
    if (reals_ == Reals::float64) {
      return parse_double(word, value);
    }
    float number = 0;
    const bool good = parse_float(word, number);
    value = number;
    return good;
  }

  TextReader text_;
  const Reals reals_;
};

}  // namespace

std::unique_ptr<PlyBody> PlyBody::open(const ByteSource& file, const PlyHeader& header, Reals reals) {
  if (header.encoding == PlyEncoding::text) {
    return std::make_unique<TextBody>(file, header, reals);
  }
  return std::make_unique<BinaryBody>(file, header);
}

}  // namespace raymill::storage
