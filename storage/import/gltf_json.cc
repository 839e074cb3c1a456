#include "storage/import/gltf_json.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "storage/import/message.h"

namespace raymill::storage {

namespace {

using nlohmann::json;

constexpr std::uint32_t kDepthMax = 128;  // glTF's own structure is 8 deep; extras go deeper

// Counts; stops at the first error or when the nesting passes kDepthMax.
class Counter final : public nlohmann::json_sax<json> {
 public:
  bool null() override { return value(); }
  bool boolean(bool /*unused*/) override { return value(); }
  bool number_integer(number_integer_t /*unused*/) override { return value(); }
  bool number_unsigned(number_unsigned_t /*unused*/) override { return value(); }
  bool number_float(number_float_t /*unused*/, const string_t& /*unused*/) override { return value(); }
  bool string(string_t& text) override {
    ++measure.blocks;
    measure.string_bytes += text.size();
    return value();
  }
  bool binary(binary_t& /*unused*/) override { return value(); }
  bool start_object(std::size_t /*unused*/) override { return enter(); }
  bool key(string_t& text) override {
    ++measure.members;
    measure.string_bytes += text.size();
    return true;
  }
  bool end_object() override { return leave(); }
  bool start_array(std::size_t /*unused*/) override { return enter(); }
  bool end_array() override { return leave(); }
  bool parse_error(std::size_t position, const std::string& /*unused*/, const json::exception& problem) override {
    constexpr int kNumberOverflow = 406;  // nlohmann's out_of_range
    error = problem.id == kNumberOverflow
                ? bad_scene("the JSON text holds a number beyond float64 before byte ", position)
                : bad_scene("the JSON text is broken at byte ", position);
    return false;
  }

  JsonMeasure measure;
  Status error;

 private:
  bool value() {
    ++measure.values;
    return true;
  }
  bool enter() {
    if (++depth_ > kDepthMax) {
      error = bad_scene("the JSON text is nested deeper than ", kDepthMax, " levels");
      return false;
    }
    ++measure.blocks;
    return value();
  }
  bool leave() {
    --depth_;
    return true;
  }

  std::uint32_t depth_ = 0;
};

}  // namespace

Result<JsonMeasure> measure_json(std::string_view text) {
  Counter counter;
  try {
    if (!json::sax_parse(text, &counter) && counter.error.ok()) {
      counter.error = bad_scene("the JSON text is broken");
    }
  } catch (const std::exception& error) {
    counter.error = bad_scene("the JSON text is broken (", error.what(), ")");
  }
  RAYMILL_RETURN_IF_ERROR(counter.error);
  return counter.measure;
}

Result<json> parse_json(std::string_view text) {
  json tree = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (tree.is_discarded()) {
    return bad_scene("the JSON text is broken");
  }
  return tree;
}

}  // namespace raymill::storage
