#include "storage/import/ply_header.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>

#include "storage/base/quotes.h"
#include "storage/import/message.h"

namespace raymill::storage {

namespace {

constexpr std::size_t kMostHeaderBytes = 64 << 10;
constexpr std::size_t kMostElements = 64;
constexpr std::size_t kMostProperties = 1024;  // of all elements

struct NamedType {
  std::string_view name;
  PlyType type;
};
constexpr NamedType kPlyTypes[] = {
    {"char", PlyType::int8},      {"int8", PlyType::int8},       {"uchar", PlyType::uint8},
    {"uint8", PlyType::uint8},    {"short", PlyType::int16},     {"int16", PlyType::int16},
    {"ushort", PlyType::uint16},  {"uint16", PlyType::uint16},   {"int", PlyType::int32},
    {"int32", PlyType::int32},    {"uint", PlyType::uint32},     {"uint32", PlyType::uint32},
    {"float", PlyType::float32},  {"float32", PlyType::float32}, {"double", PlyType::float64},
    {"float64", PlyType::float64}};

// Up to the size of an array; the rest of a longer line is one word too many.
constexpr std::size_t kMostLineWords = 6;

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  while (words.size() < kMostLineWords) {
    const std::size_t begin = line.find_first_not_of(" \t");
    if (begin == std::string_view::npos) {
      break;
    }
    const std::size_t end = std::min(line.find_first_of(" \t", begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    line.remove_prefix(end);
  }
  return words;
}

class HeaderParser {
 public:
  explicit HeaderParser(const ByteSource& file) : file_(file) {}

  Result<PlyHeader> run() {
    RAYMILL_RETURN_IF_ERROR(read_text());
    std::string_view line;
    for (number_ = 1; next_line(line); ++number_) {
      const std::vector<std::string_view> words = words_of(line);
      if (words.empty() || words[0] == "comment" || words[0] == "obj_info" || number_ == 1) {
        continue;
      }
      if (words[0] == "end_header") {
        header_.body_offset = consumed_;
        RAYMILL_RETURN_IF_ERROR(check());
        return std::move(header_);
      }
      RAYMILL_RETURN_IF_ERROR(take(words));
    }
    return bad_scene("its PLY header does not end within ", text_.size(), " bytes");
  }

 private:
  Status read_text() {
    text_.resize(std::min<std::uint64_t>(kMostHeaderBytes, file_.size_bytes()));
    RAYMILL_RETURN_IF_ERROR(file_.read(0, std::as_writable_bytes(std::span(text_))));
    // The first line says how lines end: a binary body may begin with what would be the second half of a pair.
    const std::size_t end = text_.find_first_of("\r\n");
    line_end_ = end == std::string::npos                ? "\n"
                : text_[end] == '\n'                    ? "\n"
                : text_.substr(end).starts_with("\r\n") ? "\r\n"
                                                        : "\r";
    return {};
  }

  bool next_line(std::string_view& line) {
    const std::size_t end = text_.find(line_end_, consumed_);
    if (end == std::string::npos) {
      return false;
    }
    line = std::string_view(text_).substr(consumed_, end - consumed_);
    consumed_ = end + line_end_.size();
    return true;
  }

  Status fault(std::string_view what) const { return bad_scene("line ", number_, " of its PLY header ", what); }

  Status take(const std::vector<std::string_view>& words) {
    if (words[0] == "format") {
      return take_format(words);
    }
    if (words[0] == "element") {
      return take_element(words);
    }
    if (words[0] == "property") {
      return take_property(words);
    }
    return fault(message("begins with ", in_quotes(words[0].substr(0, 40)), ", which PLY does not know"));
  }

  Status take_format(const std::vector<std::string_view>& words) {
    static constexpr std::array<std::string_view, 3> kNames = {"ascii", "binary_little_endian", "binary_big_endian"};
    const auto* const found = words.size() == 3 ? std::find(kNames.begin(), kNames.end(), words[1]) : kNames.end();
    if (found == kNames.end() || have_format_) {
      return fault("is no format that PLY knows, or a second one");
    }
    if (words[2] != "1.0") {
      return {ErrorCode::unsupported, message("is PLY version ", words[2].substr(0, 40), " and Raymill reads 1.0")};
    }
    header_.encoding = static_cast<PlyEncoding>(found - kNames.begin());
    have_format_ = true;
    return {};
  }

  Status take_element(const std::vector<std::string_view>& words) {
    std::uint64_t count = 0;
    const char* end = words.size() == 3 ? words[2].data() + words[2].size() : nullptr;
    if (end == nullptr || std::from_chars(words[2].data(), end, count).ptr != end) {
      return fault("must be an element, its name and its count");
    }
    const auto same = [&](const PlyElement& element) { return element.name == words[1]; };
    if (header_.elements.size() == kMostElements ||
        std::any_of(header_.elements.begin(), header_.elements.end(), same)) {
      return fault("is an element of a name that there is already, or one too many");
    }
    header_.elements.push_back({std::string(words[1]), count, {}});
    return {};
  }

  Status take_property(const std::vector<std::string_view>& words) {
    const bool list = words.size() == 5 && words[1] == "list";
    if (header_.elements.empty() || (words.size() != 3 && !list) || ++properties_ > kMostProperties) {
      return fault("must be a property of an element: its type and its name, or list, two types and a name");
    }
    PlyProperty property;
    property.name = words.back();
    RAYMILL_ASSIGN_OR_RETURN(property.type, type_of(words[words.size() - 2]));
    if (list) {
      RAYMILL_ASSIGN_OR_RETURN(property.list_count, type_of(words[2]));
      if (!is_integer(*property.list_count)) {
        return fault("counts a list by a type that is not a whole number");
      }
    }
    header_.elements.back().properties.push_back(std::move(property));
    return {};
  }

  Result<PlyType> type_of(std::string_view name) const {
    const auto* const found = std::find_if(std::begin(kPlyTypes), std::end(kPlyTypes),
                                           [&](const NamedType& known) { return known.name == name; });
    if (found == std::end(kPlyTypes)) {
      return fault(message("names the type ", in_quotes(name.substr(0, 40)), ", which PLY does not know"));
    }
    return found->type;
  }

  // No overflow: what is compared is divided.
  Status check() const {
    if (!have_format_) {
      return bad_scene("its PLY header names no format");
    }
    std::uint64_t left_bytes = file_.size_bytes() - header_.body_offset;
    for (const PlyElement& element : header_.elements) {
      const std::uint64_t row_bytes = element.least_row_bytes(header_.encoding);
      if (element.count != 0 && row_bytes == 0) {
        return bad_scene("its PLY header gives element ", in_quotes(element.name), " no properties");
      }
      if (element.count != 0 && left_bytes / row_bytes < element.count) {
        return bad_scene("its PLY header promises ", element.count, " rows of element ", in_quotes(element.name),
                         ", of at least ", row_bytes, " bytes each, and ", left_bytes,
                         " bytes are left; the file is damaged or was cut short");
      }
      left_bytes -= element.count * row_bytes;
    }
    return {};
  }

  const ByteSource& file_;
  std::string text_;
  std::string line_end_;
  std::size_t consumed_ = 0;
  std::uint64_t number_ = 0;
  std::size_t properties_ = 0;
  bool have_format_ = false;
  PlyHeader header_;
};

}  // namespace

std::uint32_t size_bytes(PlyType type) {
  constexpr std::array<std::uint32_t, 8> kSizes = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

const PlyProperty* PlyElement::find(std::string_view property) const {
  const auto found =
      std::find_if(properties.begin(), properties.end(), [&](const PlyProperty& one) { return one.name == property; });
  return found == properties.end() ? nullptr : &*found;
}

bool PlyElement::has_lists() const {
  return std::any_of(properties.begin(), properties.end(), [](const PlyProperty& one) { return one.list_count; });
}

std::uint64_t PlyElement::least_row_bytes(PlyEncoding encoding) const {
  std::uint64_t bytes = 0;
  for (const PlyProperty& property : properties) {
    bytes += encoding == PlyEncoding::text ? 1 : size_bytes(property.list_count.value_or(property.type));
  }
  return bytes;
}

Result<PlyHeader> read_ply_header(const ByteSource& file) { return HeaderParser(file).run(); }

}  // namespace raymill::storage
