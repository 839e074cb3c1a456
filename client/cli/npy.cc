#include "client/cli/npy.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <string_view>

namespace raymill::client {

namespace {

constexpr std::string_view kMagic("\x93NUMPY", 6);

Status malformed(const std::string& what) { return {ErrorCode::bad_rays, "not a .npy file: " + what}; }

// Reader of the one Python literal that a header is: {'descr': ..., 'fortran_order': ..., 'shape': (...), }.
class Literal {
 public:
  explicit Literal(std::string_view text) : rest_(text) {}

  bool take(char c) {
    skip_space();
    if (rest_.empty() || rest_.front() != c) {
      return false;
    }
    rest_.remove_prefix(1);
    return true;
  }

  bool word(std::string_view text) {
    skip_space();
    if (!rest_.starts_with(text)) {
      return false;
    }
    rest_.remove_prefix(text.size());
    return true;
  }

  bool string(std::string& out) {
    skip_space();
    if (rest_.empty() || (rest_.front() != '\'' && rest_.front() != '"')) {
      return false;
    }
    const std::size_t end = rest_.find(rest_.front(), 1);
    if (end == std::string_view::npos) {
      return false;
    }
    out = rest_.substr(1, end - 1);
    rest_.remove_prefix(end + 1);
    return true;
  }

  // A list of any content, as its text. Brackets inside strings do not count.
  bool list(std::string& out) {
    skip_space();
    int depth = 0;
    char quote = 0;
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      const char c = rest_[i];
      if (quote != 0) {
        quote = c == quote ? 0 : quote;
      } else if (c == '\'' || c == '"') {
        quote = c;
      } else if (c == '[') {
        ++depth;
      } else if (c == ']' && --depth == 0) {
        out = rest_.substr(0, i + 1);
        rest_.remove_prefix(i + 1);
        return true;
      }
      if (depth == 0) {
        return false;
      }
    }
    return false;
  }

  bool number(std::uint64_t& out) {
    skip_space();
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), out);
    if (error != std::errc()) {
      return false;
    }
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return true;
  }

  bool at_end() {
    skip_space();
    return rest_.empty();
  }

 private:
  void skip_space() {
    const std::size_t begin = rest_.find_first_not_of(" \t\n\r");
    rest_.remove_prefix(begin == std::string_view::npos ? rest_.size() : begin);
  }
  std::string_view rest_;
};

bool parse_shape(Literal& text, std::vector<std::uint64_t>& shape) {
  if (!text.take('(')) {
    return false;
  }
  while (!text.take(')')) {
    std::uint64_t side = 0;
    if (shape.size() == kMaxNpyDimensions || !text.number(side)) {
      return false;
    }
    shape.push_back(side);
    if (!text.take(',')) {
      return text.take(')');
    }
  }
  return true;
}

Status parse_dictionary(std::string_view source, NpyHeader& header) {
  Literal text(source);
  bool has_descr = false, has_order = false, has_shape = false;
  if (!text.take('{')) {
    return malformed("its header is not a dictionary");
  }
  while (!text.take('}')) {
    std::string key;
    if (!text.string(key) || !text.take(':')) {
      return malformed("its header has a key that is not a string");
    }
    if (key == "descr" && !has_descr) {
      has_descr = text.string(header.descr) || text.list(header.descr);
      if (!has_descr) {
        return malformed("its 'descr' is neither a string nor a list");
      }
    } else if (key == "fortran_order" && !has_order) {
      header.fortran_order = text.word("True");
      has_order = header.fortran_order || text.word("False");
      if (!has_order) {
        return malformed("its 'fortran_order' is neither True nor False");
      }
    } else if (key == "shape" && !has_shape) {
      has_shape = parse_shape(text, header.shape);
      if (!has_shape) {
        return malformed("its 'shape' is not a tuple of up to 32 counts");
      }
    } else {
      return malformed("its header has an unknown or a second key '" + key.substr(0, 40) + "'");
    }
    if (!text.take(',')) {
      if (!text.take('}')) {
        return malformed("its header's dictionary does not end");
      }
      break;
    }
  }
  if (!text.at_end()) {
    return malformed("its header goes on after the dictionary");
  }
  return has_descr && has_order && has_shape ? Status() : malformed("its header lacks descr, fortran_order or shape");
}

}  // namespace

Result<NpyHeader> parse_npy_header(std::span<const std::byte> file) {
  const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
  if (!text.starts_with(kMagic)) {
    return malformed("it does not begin with \\x93NUMPY");
  }
  if (text.size() < 10) {
    return malformed("it ends inside the header");
  }
  const unsigned major = static_cast<unsigned char>(text[6]);
  if (major < 1 || major > 3) {
    return malformed("its format version is " + std::to_string(major) + ", known are 1 to 3");
  }
  // Little-endian length: 16 bits in format 1, 32 bits after.
  const std::size_t length_bytes = major == 1 ? 2 : 4;
  const std::size_t preamble_bytes = 8 + length_bytes;
  if (text.size() < preamble_bytes) {
    return malformed("it ends inside the header");
  }
  std::size_t length = 0;
  for (std::size_t i = 0; i < length_bytes; ++i) {
    length |= static_cast<std::size_t>(static_cast<unsigned char>(text[8 + i])) << (8 * i);
  }
  if (length > kMaxNpyHeaderBytes - preamble_bytes) {
    return malformed("its header claims " + std::to_string(length) + " bytes");
  }
  if (length > text.size() - preamble_bytes) {
    return malformed("it ends inside the header");
  }
  NpyHeader header;
  RAYMILL_RETURN_IF_ERROR(parse_dictionary(text.substr(preamble_bytes, length), header));
  header.data_offset = preamble_bytes + length;
  return header;
}

std::string npy_header(const std::string& descr, std::uint64_t rows, std::uint64_t columns, std::size_t least_bytes) {
  constexpr std::size_t kAlignment = 64;
  std::string second = columns == 0 ? "" : " ";
  second += columns == 0 ? "" : std::to_string(columns);
  std::string text =
      "{'descr': " + descr + ", 'fortran_order': False, 'shape': (" + std::to_string(rows) + "," + second + "), }";
  // Spaces and one newline up to the alignment, counted with the preamble of 10 bytes.
  const std::size_t used = 10 + text.size() + 1;
  text.append(std::max((used + kAlignment - 1) / kAlignment * kAlignment, least_bytes) - used, ' ');
  text.push_back('\n');
  std::string header(kMagic);
  header.push_back(1);
  header.push_back(0);
  header.push_back(static_cast<char>(text.size() & 0xFF));
  header.push_back(static_cast<char>(text.size() >> 8));
  return header + text;
}

}  // namespace raymill::client
