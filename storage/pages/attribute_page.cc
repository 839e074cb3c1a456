#include "storage/pages/attribute_page.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <string_view>
#include <unordered_map>

#include "storage/pages/codec.h"
#include "storage/pages/planes.h"

namespace raymill::storage {
namespace {

// 2^16 to a page, of 2^32 pages.
constexpr std::uint64_t kMostEntries = std::uint64_t{1} << 48;

struct EncodedAttributeHeader {
  std::uint16_t page_type = kPageTypeAttribute;
  std::uint8_t codec = 0;
  AttributePageKind kind = AttributePageKind::entries;
  std::uint32_t count = 0;
  std::uint32_t distinct = 0;  ///< items of the streams: corners that differ, or geometries
  std::uint8_t attributes = 0;
  std::array<std::uint8_t, 11> reserved{};
  std::uint32_t streams_bytes = 0;  ///< before compression; raw: 0
  std::uint32_t payload_bytes = 0;
  std::uint32_t reserved_too = 0;
};
static_assert(sizeof(EncodedAttributeHeader) == sizeof(EncodedHeader));

Status bad_attribute_page(const char* what) { return {ErrorCode::corrupt, std::string("page of attributes ") + what}; }

// Words of what the streams hold one of: a corner, or a geometry.
std::uint32_t words_per_item(AttributePageKind kind, AttributeSet set) {
  return kind == AttributePageKind::geometries ? sizeof(AttributeGeometry) / sizeof(std::uint32_t) : corner_floats(set);
}
std::uint64_t streams_bytes(AttributePageKind kind, AttributeSet set, std::uint64_t count, std::uint64_t distinct) {
  const std::uint64_t corners = kind == AttributePageKind::entries ? 3 * count : 0;
  return sizeof(std::uint32_t) * (corners + distinct * words_per_item(kind, set));
}

// The corners of entries that differ, in the order of first use, and for each corner how long ago its like was new.
struct Corners {
  std::vector<std::uint32_t> first_use;  // [distinct]
  std::vector<std::uint32_t> codes;      // [corner]: (number of different ones so far) - which; 0: a new one
};

Corners find_corners(std::span<const std::byte> entries, std::size_t corner_bytes) {
  Corners corners;
  std::unordered_map<std::string_view, std::uint32_t> known;
  const std::size_t count = entries.size() / corner_bytes;
  corners.codes.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string_view bytes(reinterpret_cast<const char*>(entries.data()) + i * corner_bytes, corner_bytes);
    const auto distinct = static_cast<std::uint32_t>(corners.first_use.size());
    const auto [at, is_new] = known.try_emplace(bytes, distinct);
    corners.codes.push_back(distinct - at->second);
    if (is_new) {
      corners.first_use.push_back(static_cast<std::uint32_t>(i));
    }
  }
  return corners;
}

std::uint32_t word_at(const std::byte* items, std::size_t index) {
  std::uint32_t word;
  std::memcpy(&word, items + index * sizeof word, sizeof word);
  return word;
}

// For each word of an item: a delta stream of it over the items named.
void write_item_words(const std::byte* items, std::span<const std::uint32_t> which, std::uint32_t words,
                      PlaneWriter& out) {
  std::vector<std::uint32_t> deltas(which.size());
  for (std::uint32_t word = 0; word < words; ++word) {
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < which.size(); ++i) {
      const std::uint32_t value = word_at(items, std::size_t{which[i]} * words + word);
      deltas[i] = zigzag(value - last);
      last = value;
    }
    out.put<std::uint32_t>(deltas);
  }
}

void read_item_words(PlaneReader& in, std::span<const std::uint32_t> which, std::uint32_t words, std::byte* items) {
  std::vector<std::uint32_t> deltas(which.size());
  for (std::uint32_t word = 0; word < words; ++word) {
    in.get<std::uint32_t>(deltas);
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < which.size(); ++i) {
      value += unzigzag(deltas[i]);
      std::memcpy(items + (std::size_t{which[i]} * words + word) * sizeof value, &value, sizeof value);
    }
  }
}

std::vector<std::uint32_t> every_item(std::uint32_t count) {
  std::vector<std::uint32_t> which(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    which[i] = i;
  }
  return which;
}

// Corners that are new, as the codes say; false: they are not as many as the head says, or name what was not yet.
bool read_corners(std::span<std::uint32_t> codes, std::uint32_t distinct, std::vector<std::uint32_t>& first_use) {
  first_use.reserve(distinct);
  for (std::uint32_t i = 0; i < codes.size(); ++i) {
    if (codes[i] > first_use.size() || (codes[i] == 0 && first_use.size() == distinct)) {
      return false;
    }
    if (codes[i] == 0) {
      first_use.push_back(i);
    }
    codes[i] = first_use[first_use.size() - std::max(codes[i], 1U)];
  }
  return first_use.size() == distinct;
}

Status read_entries(PlaneReader& in, std::uint32_t count, std::uint32_t distinct, std::uint32_t words,
                    std::byte* entries) {
  std::vector<std::uint32_t> source(std::size_t{3} * count), first_use;
  in.get<std::uint32_t>(source);
  if (in.failed() || !read_corners(source, distinct, first_use)) {
    return bad_attribute_page("names corners that it does not have");
  }
  read_item_words(in, first_use, words, entries);
  const std::size_t corner_bytes = words * sizeof(std::uint32_t);
  for (std::size_t i = 0; i < source.size(); ++i) {
    if (source[i] != i) {
      std::memcpy(entries + i * corner_bytes, entries + source[i] * corner_bytes, corner_bytes);
    }
  }
  return {};
}

Status check_geometries(const AttributePageView& view, AttributeSet set) {
  for (std::uint32_t i = 0; i < view.header().count; ++i) {
    const AttributeGeometry& geometry = view.geometry(i);
    if ((geometry.present & ~set) != 0 || (geometry.triangle_count == 0) != (geometry.present == 0) ||
        geometry.reserved != 0 || geometry.first_entry >= kMostEntries) {
      return bad_attribute_page("holds a geometry with attributes that no store has");
    }
  }
  return {};
}

}  // namespace

AttributePlaces::AttributePlaces(AttributeSet attributes, std::uint32_t attribute_page, std::uint32_t page_bytes,
                                 std::uint64_t geometry_count, std::uint32_t pages)
    : set(attributes),
      first_page(attribute_page),
      page_count(pages),
      geometries_per_page(attribute_items_per_page(AttributePageKind::geometries, set, page_bytes)),
      entries_per_page(attribute_items_per_page(AttributePageKind::entries, set, page_bytes)) {
  const std::uint64_t of_geometries = (geometry_count + geometries_per_page - 1) / geometries_per_page;
  entries_page = static_cast<std::uint32_t>(std::min<std::uint64_t>(first_page + of_geometries, page_count));
}

std::vector<std::byte> make_attribute_page(AttributePageKind kind, AttributeSet set, std::span<const std::byte> items) {
  AttributePageHeader header;
  header.kind = kind;
  header.attributes = static_cast<std::uint8_t>(set);
  header.count = static_cast<std::uint32_t>(items.size() / attribute_item_bytes(kind, set));
  header.image_bytes = static_cast<std::uint32_t>(sizeof header + items.size());
  std::vector<std::byte> image(header.image_bytes);
  std::memcpy(image.data(), &header, sizeof header);
  std::copy(items.begin(), items.end(), image.begin() + sizeof header);
  return image;
}

std::vector<std::byte> encode_attribute_page(std::span<const std::byte> image, Codec codec) {
  const AttributePageHeader& header = AttributePageView(image.data()).header();
  const auto items = image.subspan(sizeof header);
  const std::uint32_t words = words_per_item(header.kind, header.attributes);
  EncodedAttributeHeader encoded;
  encoded.codec = static_cast<std::uint8_t>(codec == Codec::draco ? Codec::zstd : codec);
  encoded.kind = header.kind;
  encoded.count = header.count;
  encoded.attributes = header.attributes;
  std::vector<std::byte> payload(items.begin(), items.end());
  if (codec != Codec::raw) {
    std::vector<std::byte> streams;
    PlaneWriter out(streams);
    std::vector<std::uint32_t> which;
    if (header.kind == AttributePageKind::entries) {
      Corners corners = find_corners(items, words * sizeof(std::uint32_t));
      out.put<std::uint32_t>(corners.codes);
      which = std::move(corners.first_use);
    } else {
      which = every_item(header.count);
    }
    write_item_words(items.data(), which, words, out);
    encoded.distinct = static_cast<std::uint32_t>(which.size());
    encoded.streams_bytes = static_cast<std::uint32_t>(streams.size());
    payload = compress(streams, static_cast<Codec>(encoded.codec));
  }
  encoded.payload_bytes = static_cast<std::uint32_t>(payload.size());
  std::vector<std::byte> bytes(sizeof encoded + payload.size());
  std::memcpy(bytes.data(), &encoded, sizeof encoded);
  std::copy(payload.begin(), payload.end(), bytes.begin() + sizeof encoded);
  return bytes;
}

Result<std::uint32_t> decode_attribute_page(
    std::span<const std::byte> encoded, std::span<std::byte> frame, const PageRules& rules,
    const std::function<std::optional<std::span<const std::byte>>(std::span<const std::byte> bytes, Codec codec,
                                                                  std::size_t expected)>& decompress) {
  EncodedAttributeHeader header;
  if (encoded.size() < sizeof header) {
    return bad_attribute_page("is shorter than its header");
  }
  std::memcpy(&header, encoded.data(), sizeof header);
  const auto payload = encoded.subspan(sizeof header);
  const bool known = header.page_type == kPageTypeAttribute && header.codec <= static_cast<std::uint8_t>(Codec::zstd) &&
                     (header.kind == AttributePageKind::entries || header.kind == AttributePageKind::geometries) &&
                     header.attributes != 0 && header.attributes == rules.attributes;
  if (!known || header.count == 0 || header.payload_bytes != payload.size() ||
      header.count > attribute_items_per_page(header.kind, header.attributes, rules.page_bytes)) {
    return bad_attribute_page("is of no known type or has counts that do not fit its size");
  }
  AttributePageHeader image;
  image.kind = header.kind;
  image.attributes = header.attributes;
  image.count = header.count;
  image.image_bytes =
      static_cast<std::uint32_t>(sizeof image) + header.count * attribute_item_bytes(header.kind, header.attributes);
  const std::size_t items_bytes = image.image_bytes - sizeof image;
  const auto codec = static_cast<Codec>(header.codec);
  const bool entries = header.kind == AttributePageKind::entries;
  const std::uint64_t most = entries ? std::uint64_t{3} * header.count : header.count;
  const bool counts_fit =
      codec == Codec::raw
          ? payload.size() == items_bytes
          : header.distinct > 0 && header.distinct <= most && (entries || header.distinct == most) &&
                header.streams_bytes == streams_bytes(header.kind, header.attributes, header.count, header.distinct);
  if (image.image_bytes > frame.size() || !counts_fit) {
    return bad_attribute_page("has counts that do not fit its size");
  }
  std::memcpy(frame.data(), &image, sizeof image);
  std::byte* items = frame.data() + sizeof image;
  if (codec == Codec::raw) {
    std::copy(payload.begin(), payload.end(), items);
  } else {
    const auto streams = decompress(payload, codec, header.streams_bytes);
    if (!streams) {
      return bad_attribute_page("cannot be decompressed");
    }
    PlaneReader in(*streams);
    const std::uint32_t words = words_per_item(header.kind, header.attributes);
    if (entries) {
      RAYMILL_RETURN_IF_ERROR(read_entries(in, header.count, header.distinct, words, items));
    } else {
      read_item_words(in, every_item(header.count), words, items);
    }
    if (!in.exhausted()) {
      return bad_attribute_page("has streams of another length than its counts");
    }
  }
  if (!entries) {
    RAYMILL_RETURN_IF_ERROR(check_geometries(AttributePageView(frame.data()), header.attributes));
  }
  return image.image_bytes;
}

}  // namespace raymill::storage
